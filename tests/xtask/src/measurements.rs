//! What is measured.
//!
//! In a command, `DATA/` is the data folder, `WORLD/` one of [`WORLDS`], compiled when needed, and
//! `OUT/` a folder for what nobody reads.

use crate::measurement::{Measurement, Program, Run};

/// A world that measurements need.
pub struct WorldSource {
    /// What measurements call it.
    pub name: &'static str,
    /// Its model in the data folder.
    pub source: &'static str,
    /// Flags of `compile`.
    pub flags: &'static [&'static str],
}

/// All worlds that measurements need.
pub const WORLDS: &[WorldSource] = &[
    WorldSource { name: "rooms400", source: "traces/rooms400.glb", flags: &[] },
    WorldSource { name: "oa_dm2", source: "maps/oa_dm2.bsp", flags: &[] },
    WorldSource { name: "oa_dm4", source: "maps/oa_dm4.bsp", flags: &[] },
    WorldSource { name: "aggressor", source: "maps/aggressor.bsp", flags: &[] },
    WorldSource { name: "delta", source: "maps/delta.bsp", flags: &[] },
    WorldSource { name: "oa_dm2-fine", source: "maps/oa_dm2.bsp", flags: &["--voxel", "0.018"] },
];

const REPLAY: &[(&str, &str)] = &[
    ("others held, mean", "/held_mean"),
    ("misses", "/oracle/misses"),
    ("over-send", "/oracle/over_send"),
    ("over-send against the horizon", "/oracle/over_send_horizon"),
    ("bytes/s to a client", "/bytes_to_client"),
    ("messages/s to a client", "/messages_to_client"),
    ("hidden reports, share of ticks", "/oracle/hidden_reports"),
    ("tick, CPU ms, median", "/tick_cpu_median_ms"),
    ("99th percentile", "/tick_cpu_p99_ms"),
];

macro_rules! replay {
    ($label:literal, $world:literal, $trace:literal, $rtt:literal, $oracle:literal) => {
        Run {
            label: $label,
            args: &[
                "replay",
                concat!("WORLD/", $world),
                concat!("DATA/traces/", $trace),
                "--rtt",
                $rtt,
            ],
            full: &["--oracle", $oracle],
            quick: &["--seconds", "2"],
        }
    };
}

macro_rules! promise {
    ($world:literal, $trace:literal, $rtt:literal, $loss:literal $(, $more:literal)?) => {
        Run {
            label: $trace,
            args: &[
                "replay",
                concat!("WORLD/", $world),
                concat!("DATA/traces/", $trace, ".csv.gz"),
                "--rtt",
                $rtt,
                "--loss",
                $loss,
                $($more,)?
                "--seconds",
            ],
            full: &["20"],
            quick: &["2"],
        }
    };
}

macro_rules! fault {
    ($fault:literal) => {
        Run {
            label: $fault,
            args: &["--fault", $fault, "--seeds"],
            full: &["200", "--buildings", "40"],
            quick: &["8", "--buildings", "4"],
        }
    };
}

const STEPS: &[(&str, &str)] = &[
    ("cube", "/cube"),
    ("depth", "/depth"),
    ("N, ns", "/naive_ns"),
    ("B, ns", "/ours_ns"),
    ("speed-up", "/speed_up"),
    ("nodes visited, N over B", "/nodes_ratio"),
    ("share of steps to other nodes", "/changing"),
    ("speed-up of these", "/changing_speed_up"),
];

macro_rules! verify {
    ($world:literal) => {
        Run {
            label: $world,
            args: &["inspect", concat!("WORLD/", $world), "--verify"],
            full: &["10000000"],
            quick: &["10000", "--entries", "0"],
        }
    };
}

macro_rules! streaming {
    ($label:literal, $world:literal, $seconds:literal, $walks:literal) => {
        Run {
            label: $label,
            args: &[concat!("WORLD/", $world), "--seconds"],
            full: &[$seconds, "--walks", $walks, "--spawns", "12"],
            quick: &["2", "--walks", "1", "--spawns", "1"],
        }
    };
}

/// Everything that is measured.
pub const ALL: &[Measurement] = &[
    Measurement {
        name: "replay",
        title: "Over-send and misses over whole traces",
        note: "Over-send is what is held for each avatar that rays see. A tick's time is that of the engine.",
        program: Program::Server,
        runs: &[
            replay!("rooms400-60, 0 ms", "rooms400", "rooms400-60.csv.gz", "0", "50"),
            replay!("rooms400-60, 100 ms", "rooms400", "rooms400-60.csv.gz", "100", "50"),
            replay!("rooms400-500, 100 ms", "rooms400", "rooms400-500.csv.gz", "100", "4000"),
            replay!("oa_dm2-32, 0 ms", "oa_dm2", "oa_dm2-32.csv.gz", "0", "50"),
            replay!("oa_dm2-32, 100 ms", "oa_dm2", "oa_dm2-32.csv.gz", "100", "50"),
            replay!("delta-60, 0 ms", "delta", "delta-60.csv.gz", "0", "100"),
            replay!("delta-60, 100 ms", "delta", "delta-60.csv.gz", "100", "100"),
        ],
        rows: "",
        columns: REPLAY,
    },
    Measurement {
        name: "promise",
        title: "Where avatars are shown, against the promise of freshness",
        note: "How far a visible avatar is shown from where it was one delay and two ticks ago, and by \
               how much it is turned, the larger of yaw and pitch. The first 20 s of traces. Reports \
               by exception, or at every tick, which needs no tolerance. A person may be off its \
               course by 5 to 7 cm where somebody holds it, a player of Quake by 9.5 to 13 cm, and \
               a distant viewer is told less exactly, to 18 and 34 cm.",
        program: Program::Server,
        runs: &[
            promise!("rooms400", "rooms400-60", "0", "0"),
            promise!("rooms400", "rooms400-60", "0", "0", "--every-tick"),
            promise!("rooms400", "rooms400-60", "0", "5"),
            promise!("rooms400", "rooms400-60", "0", "5", "--every-tick"),
            promise!("rooms400", "rooms400-60", "100", "0"),
            promise!("rooms400", "rooms400-60", "100", "0", "--every-tick"),
            promise!("rooms400", "rooms400-60", "100", "5"),
            promise!("rooms400", "rooms400-60", "100", "5", "--every-tick"),
            promise!("rooms400", "rooms400-60", "200", "0"),
            promise!("rooms400", "rooms400-60", "200", "0", "--every-tick"),
            promise!("rooms400", "rooms400-60", "200", "5"),
            promise!("rooms400", "rooms400-60", "200", "5", "--every-tick"),
            promise!("oa_dm2", "oa_dm2-32", "0", "0"),
            promise!("oa_dm2", "oa_dm2-32", "0", "0", "--every-tick"),
            promise!("oa_dm2", "oa_dm2-32", "0", "5"),
            promise!("oa_dm2", "oa_dm2-32", "0", "5", "--every-tick"),
            promise!("oa_dm2", "oa_dm2-32", "100", "0"),
            promise!("oa_dm2", "oa_dm2-32", "100", "0", "--every-tick"),
            promise!("oa_dm2", "oa_dm2-32", "100", "5"),
            promise!("oa_dm2", "oa_dm2-32", "100", "5", "--every-tick"),
            promise!("oa_dm2", "oa_dm2-32", "200", "0"),
            promise!("oa_dm2", "oa_dm2-32", "200", "0", "--every-tick"),
            promise!("oa_dm2", "oa_dm2-32", "200", "5"),
            promise!("oa_dm2", "oa_dm2-32", "200", "5", "--every-tick"),
            promise!("delta", "delta-60", "0", "0"),
            promise!("delta", "delta-60", "0", "0", "--every-tick"),
            promise!("delta", "delta-60", "0", "5"),
            promise!("delta", "delta-60", "0", "5", "--every-tick"),
            promise!("delta", "delta-60", "100", "0"),
            promise!("delta", "delta-60", "100", "0", "--every-tick"),
            promise!("delta", "delta-60", "100", "5"),
            promise!("delta", "delta-60", "100", "5", "--every-tick"),
            promise!("delta", "delta-60", "200", "0"),
            promise!("delta", "delta-60", "200", "0", "--every-tick"),
            promise!("delta", "delta-60", "200", "5"),
            promise!("delta", "delta-60", "200", "5", "--every-tick"),
        ],
        rows: "",
        columns: &[
            ("round trip, ms", "/round_trip_ms"),
            ("lost, %", "/loss_percent"),
            ("by exception", "/by_exception"),
            ("off, m, median", "/oracle/promised_error_p50_m"),
            ("99th percentile", "/oracle/promised_error_p99_m"),
            ("turned, degrees, median", "/oracle/promised_error_p50_deg"),
            ("99th percentile ", "/oracle/promised_error_p99_deg"),
            ("misses", "/oracle/misses"),
            ("by late messages", "/oracle/misses_late"),
            ("messages/s from a client", "/messages_from_client"),
        ],
    },
    Measurement {
        name: "policies",
        title: "Policies side by side",
        note: "The first five seconds of 500 people in 400 rooms, with a round trip of 100 ms.",
        program: Program::Server,
        runs: &[Run {
            label: "rooms400-500",
            args: &[
                "replay",
                "WORLD/rooms400",
                "DATA/traces/rooms400-500.csv.gz",
                "--policy",
                "all",
                "--seconds",
            ],
            full: &["5"],
            quick: &["1"],
        }],
        rows: "",
        columns: &[
            ("policy", "/policy"),
            ("others held, mean", "/held_mean"),
            ("misses", "/oracle/misses"),
            ("over-send", "/oracle/over_send"),
            ("states/s to a client", "/updates_to_client"),
            ("bytes/s to a client", "/bytes_to_client"),
            ("messages/s to a client", "/messages_to_client"),
        ],
    },
    Measurement {
        name: "tbvs",
        title: "Kinds of TBVs",
        note: "The first minute of 60 people in 400 rooms, with a round trip of 100 ms.",
        program: Program::Server,
        runs: &[Run {
            label: "rooms400-60",
            args: &[
                "replay",
                "WORLD/rooms400",
                "DATA/traces/rooms400-60.csv.gz",
                "--validity",
                "all",
                "--seconds",
            ],
            full: &["60"],
            quick: &["2"],
        }],
        rows: "",
        columns: &[
            ("shape", "/shape"),
            ("validity", "/validity"),
            ("hidden reports, share of ticks", "/oracle/hidden_reports"),
            ("asks/s", "/asks_per_s"),
            ("tick, CPU ms, median", "/tick_cpu_median_ms"),
        ],
    },
    Measurement {
        name: "verify",
        title: "The PVS compared with rays",
        note: "Pairs of random points of open space: P(PVS) / P(sight), and that of the map's own PVS.",
        program: Program::Server,
        runs: &[
            verify!("oa_dm4"),
            verify!("aggressor"),
            verify!("oa_dm2"),
            verify!("delta"),
            verify!("rooms400"),
        ],
        rows: "",
        columns: &[
            ("over-send", "/over_send"),
            ("the map's own", "/own_over_send"),
            ("misses", "/misses"),
            ("the map's own", "/own_misses"),
            ("looseness", "/looseness"),
            ("the map's own", "/own_looseness"),
        ],
    },
    Measurement {
        name: "drawing",
        title: "Drawing, beside a ray for each pixel",
        note: "CPU time of one thread for 1920 × 1080 pixels from the spawn points. A ratio is the time of rays, by obvhs, over that of the row.",
        program: Program::Client,
        runs: &[Run {
            label: "oa_dm2, 18 mm",
            args: &["bench", "WORLD/oa_dm2-fine"],
            full: &[],
            quick: &["--size", "320x180", "--frames", "2", "--repeats", "1"],
        }],
        rows: "/runs/0/rows",
        columns: &[
            ("", "/name"),
            ("median, ms", "/cpu_ms/spawns/median"),
            ("worst, ms", "/cpu_ms/spawns/worst"),
            ("times as fast as BVH2", "/ratio_bvh2"),
            ("as CWBVH", "/ratio_cwbvh"),
        ],
    },
    Measurement {
        name: "modes",
        title: "The renderer's modes compared",
        note: "Shares of pixels that differ by more than rounding, and of projections left, from the spawn points and along a path.",
        program: Program::Client,
        runs: &[Run {
            label: "oa_dm2, 18 mm",
            args: &["bench", "WORLD/oa_dm2-fine", "--compare"],
            full: &[],
            quick: &["--size", "320x180", "--frames", "2"],
        }],
        rows: "/comparisons",
        columns: &[
            ("width", "/width"),
            ("height", "/height"),
            ("differing, median", "/differing/median"),
            ("worst", "/differing/worst"),
            ("largest shift, pixels", "/shift_max"),
            ("projections left, median", "/projections/median"),
        ],
    },
    Measurement {
        name: "compile",
        title: "The octree's bytes",
        note: "On the wire means packed, as in the world file.",
        program: Program::Server,
        runs: &[Run {
            label: "oa_dm2",
            args: &["compile", "DATA/maps/oa_dm2.bsp", "-o", "OUT/octree.slw", "--voxel"],
            full: &["0.018"],
            quick: &["0.25"],
        }],
        rows: "",
        columns: &[
            ("voxels", "/voxels"),
            ("voxel, m", "/voxel_m"),
            ("bytes a voxel in memory", "/memory_bytes_per_voxel"),
            ("on the wire", "/wire_bytes_per_voxel"),
        ],
    },
    Measurement {
        name: "worlds",
        title: "Compiling worlds",
        note: "CPU seconds are those of all threads together. Sight is carving, cells and portals, and the PVS.",
        program: Program::Bench("worlds"),
        runs: &[Run {
            label: "",
            args: &[],
            full: &[],
            quick: &["--rooms", "4", "--no-maps", "--pairs", "1000"],
        }],
        rows: "",
        columns: &[
            ("world", "/name"),
            ("cells", "/cells"),
            ("portals", "/portals"),
            ("carving, CPU s", "/cpu_seconds/0"),
            ("cells, CPU s", "/cpu_seconds/1"),
            ("PVS, CPU s", "/cpu_seconds/2"),
            ("whole, s", "/seconds"),
            ("over-send", "/over_send"),
            ("misses", "/misses"),
        ],
    },
    Measurement {
        name: "engine",
        title: "A tick of the engine as the crowd grows",
        note: "People who walk in a generated building of 2,000 rooms, 100 ms away, some with others hidden beside it.",
        program: Program::Bench("engine"),
        runs: &[Run {
            label: "",
            args: &["--avatars"],
            full: &["1000,3000,10000"],
            quick: &["50", "--rooms", "20", "--seconds", "1"],
        }],
        rows: "",
        columns: &[
            ("policy", "/policy"),
            ("threads", "/threads"),
            ("walkers", "/walkers"),
            ("hidden", "/hidden"),
            ("tick, CPU ms, median", "/cpu_median_ms"),
            ("99th percentile", "/cpu_p99_ms"),
            ("by the clock, ms", "/wall_median_ms"),
            ("others held, mean", "/held_mean"),
            ("memory, MB", "/memory_mb"),
        ],
    },
    Measurement {
        name: "simulation",
        title: "Simulation",
        note: "Random buildings, walks and networks, compared with brute force at every tick. Misses are those with the excuse of a late message.",
        program: Program::Bench("simulation"),
        runs: &[Run {
            label: "without a fault",
            args: &["--seeds"],
            full: &["10000"],
            quick: &["4"],
        }],
        rows: "/totals",
        columns: &[
            ("simulations", "/simulations"),
            ("with a broken promise", "/broken"),
            ("visible pairs", "/pairs_visible"),
            ("misses", "/misses_late"),
            ("misses after jumps", "/misses_after_jumps"),
            ("hidden ticks", "/hidden_ticks"),
            ("asks", "/asks"),
        ],
    },
    Measurement {
        name: "faults",
        title: "Faults that the simulation finds",
        note: "Faults put into the engine: in how many seeds each could act, and in how many of these it was found.",
        program: Program::Bench("simulation"),
        runs: &[
            fault!("small-tbv"),
            fault!("short-notice"),
            fault!("lost-portal"),
            fault!("late-expiry"),
            fault!("wide-regions"),
        ],
        rows: "/detection",
        columns: &[("seeds", "/all"), ("could act", "/acted"), ("found", "/found")],
    },
    Measurement {
        name: "box-visibility",
        title: "What box visibility excludes of what the PVS lets through",
        note: "Shares of pairs of people, with a box of that size around each. Rays between 27 points in each box find what is seen, and so too little.",
        program: Program::Bench("box_visibility"),
        runs: &[Run { label: "", args: &[], full: &[], quick: &["--rooms", "4", "--pairs", "20"] }],
        rows: "",
        columns: &[
            ("building", "/building"),
            ("radius, m", "/radius_m"),
            ("seen, %", "/seen_percent"),
            ("PVS, %", "/pvs_percent"),
            ("PVS and test, %", "/both_percent"),
            ("undecided, %", "/unknown_percent"),
            ("units of work, median", "/units/median"),
            ("µs, median", "/micros/median"),
            ("99th percentile", "/micros/p99"),
        ],
    },
    Measurement {
        name: "form_factors",
        title: "Form factors by hemicubes and by rays",
        note: "CPU time of one thread for each receiver. Hemicubes of 32 pixels are drawn with all triangles, and with those that fuzzy projection, box visibility or the PVS leave; the time of making lists counts. Rays have the directions of the pixels. The compiler casts 512 of them.",
        program: Program::Bench("form_factors"),
        runs: &[Run { label: "", args: &["--rooms"], full: &["1,4,60,400"], quick: &["1,4"] }],
        rows: "",
        columns: &[
            ("rooms", "/rooms"),
            ("triangles", "/triangles"),
            ("all, ms", "/all_ms"),
            ("fuzzy, ms", "/fuzzy_ms"),
            ("box visibility, ms", "/box_ms"),
            ("PVS, ms", "/pvs_ms"),
            ("rays, ms", "/rays_ms"),
            ("512 rays, ms", "/compiler_rays_ms"),
            ("left by fuzzy", "/fuzzy_left"),
            ("by box visibility", "/box_left"),
            ("by PVS", "/pvs_left"),
            ("greatest difference", "/differs"),
        ],
    },
    Measurement {
        name: "form_factors_accuracy",
        title: "Form factors at several accuracies, and rays with lists",
        note: "CPU time of one thread for each receiver. Hemicubes of 8, 32 and 128 pixels are drawn with what fuzzy projection and box visibility leave; the time of making lists does not count. Rays have the directions of 32 pixels, in a tree of all triangles and in one of a group's list. Bytes are those of a list by fuzzy projection: four for each entry, and the smallest two lists by differences.",
        program: Program::Bench("form_factors"),
        runs: &[Run { label: "", args: &["--rooms"], full: &["1,4,60,400"], quick: &["1,4"] }],
        rows: "",
        columns: &[
            ("rooms", "/rooms"),
            ("fuzzy, 8 pixels, ms", "/fuzzy_by_pixels_ms/0"),
            ("32 pixels", "/fuzzy_by_pixels_ms/1"),
            ("128 pixels", "/fuzzy_by_pixels_ms/2"),
            ("box visibility, 8 pixels, ms", "/box_by_pixels_ms/0"),
            ("32 pixels", "/box_by_pixels_ms/1"),
            ("128 pixels", "/box_by_pixels_ms/2"),
            ("rays, ms", "/rays_ms"),
            ("rays with lists, ms", "/listed_rays_ms"),
            ("trees of lists, ms", "/listed_trees_ms"),
            ("bytes of a list", "/list_bytes"),
            ("packed", "/packed_bytes"),
        ],
    },
    Measurement {
        name: "fuzzy",
        title: "What fuzzy projection saves a Z-buffer",
        note: "Lim's Examples 1 to 4 in kind: five views of rooms in a row, CPU time of one thread. Normal draws every patch; the rest leaves out those that are invisible from a box around the eyes. The second ratio includes the time to find these.",
        program: Program::Bench("fuzzy"),
        runs: &[Run { label: "", args: &["--runs"], full: &["5"], quick: &["1"] }],
        rows: "",
        columns: &[
            ("patches", "/patches"),
            ("pixels a side", "/pixels"),
            ("rooms", "/rooms"),
            ("in all", "/patches_in_all"),
            ("invisible", "/invisible"),
            ("normal, ms", "/normal_ms"),
            ("rest, ms", "/rest_ms"),
            ("ratio", "/ratio"),
            ("Lim's", "/lim_ratio"),
            ("finding, ms", "/sorting_ms"),
            ("ratio with it", "/ratio_with_sorting"),
            ("Lim's", "/lim_ratio_with_sorting"),
        ],
    },
    Measurement {
        name: "occupants-cubes",
        title: "Moving a cube along a large one",
        note: "Sudarsky and Gotsman (1996), section 4.1, test scene 1: their method B against the naive method N.",
        program: Program::Bench("occupants"),
        runs: &[Run { label: "", args: &["--budget-ms"], full: &["300"], quick: &["1"] }],
        rows: "/scene_1",
        columns: STEPS,
    },
    Measurement {
        name: "occupants-table",
        title: "Moving a cube about a table for four",
        note: "Sudarsky and Gotsman (1996), section 4.1, test scene 2. The last columns count only steps in which the cube changes nodes.",
        program: Program::Bench("occupants"),
        runs: &[Run { label: "", args: &["--budget-ms"], full: &["300"], quick: &["1"] }],
        rows: "/scene_2",
        columns: STEPS,
    },
    Measurement {
        name: "volumes",
        title: "Two indices of volumes: an octree, and lists by spaces",
        note: "Boxes around avatars in a generated building of 200 rooms; a part of them walk. Medians in ns for each volume. Lists need the spaces of a box first, which the engine knows.",
        program: Program::Bench("volumes"),
        runs: &[Run {
            label: "",
            args: &["--volumes"],
            full: &["1000,10000"],
            quick: &["50", "--rooms", "4"],
        }],
        rows: "",
        columns: &[
            ("volumes", "/volumes"),
            ("who moves", "/motion"),
            ("insert, octree", "/insert/octree_ns"),
            ("finding spaces", "/insert/spaces/find_ns"),
            ("lists", "/insert/spaces/lists_ns"),
            ("move, octree", "/moves/octree_ns"),
            ("octree, grouped", "/moves/octree_grouped_ns"),
            ("finding spaces", "/moves/spaces/find_ns"),
            ("lists", "/moves/spaces/lists_ns"),
        ],
    },
    Measurement {
        name: "drawing-loops",
        title: "The renderer's inner loops",
        note: "CPU time of one thread for each of 1920 × 1080 pixels, the least of several rounds.",
        program: Program::Bench("drawing"),
        runs: &[Run { label: "", args: &[], full: &[], quick: &[] }],
        rows: "/per_pixel",
        columns: &[
            ("scene", "/scene"),
            ("orthogonal, ns", "/orthogonal_ns"),
            ("perspective, ns", "/perspective_ns"),
            ("share of pixels hit", "/hit"),
        ],
    },
    Measurement {
        name: "drawing-modes",
        title: "The renderer's modes in many buildings",
        note: "CPU time of one thread for 1280 × 720 pixels, the median over spawn points. A share is \
               that of orthogonal mode in perspective mode. The mode forms takes form patterns and \
               layers wherever perspective allows it.",
        program: Program::Bench("modes"),
        runs: &[Run {
            label: "",
            args: &[],
            full: &["--views", "8", "--repeats", "3"],
            quick: &["--only", "demo", "--views", "1", "--repeats", "1"],
        }],
        rows: "/rows",
        columns: &[
            ("building", "/building"),
            ("voxel, m", "/voxel_m"),
            ("perspective, ms", "/perspective_ms"),
            ("orthogonal, ms", "/orthogonal_ms"),
            ("forms, ms", "/forms_ms"),
            ("share, spawns", "/spawns"),
            ("share, walk", "/walk"),
            ("forms, share", "/forms_spawns"),
        ],
    },
    Measurement {
        name: "streaming",
        title: "Worlds that arrive in pieces",
        note: "Over a simulated link of 10 Mbit/s with a delay of 50 ms one way, without the time that \
               drawing takes: from the spawn points, and along random walks. Shares are by the file \
               of the world, and by what is visible along the walk.",
        program: Program::Bench("streaming"),
        runs: &[
            streaming!("rooms400, walks of 30 s", "rooms400", "30", "20"),
            streaming!("rooms400, walk of 5 min", "rooms400", "300", "1"),
            streaming!("oa_dm2, 18 mm", "oa_dm2-fine", "30", "20"),
        ],
        rows: "",
        columns: &[
            ("file, bytes", "/file_bytes"),
            ("head, bytes", "/head_bytes"),
            ("first picture, s", "/summary/first_picture_s/1"),
            ("sharp, s, median", "/summary/sharp_s/0"),
            ("worst", "/summary/sharp_s/1"),
            ("transferred by then, share", "/summary/sharp_share/0"),
            ("worst", "/summary/sharp_share/1"),
            ("walks, share", "/summary/walk_share/0"),
            ("worst", "/summary/walk_share/1"),
            ("waited, s", "/summary/waited_s"),
        ],
    },
    Measurement {
        name: "octree-loops",
        title: "Writing and reading an octree",
        note: "CPU time of one thread for each voxel of hills, the least of several rounds.",
        program: Program::Bench("drawing"),
        runs: &[Run { label: "hills", args: &[], full: &[], quick: &[] }],
        rows: "/per_voxel",
        columns: &[("written, ns", "/written_ns"), ("read, ns", "/read_ns"), ("bytes", "/bytes")],
    },
    Measurement {
        name: "forms",
        title: "Placing octants by form patterns",
        note: "CPU time of one thread for each node, the least of several rounds.",
        program: Program::Bench("forms"),
        runs: &[Run { label: "", args: &[], full: &[], quick: &[] }],
        rows: "",
        columns: &[("method", "/method"), ("ns a node", "/ns_per_node")],
    },
];
