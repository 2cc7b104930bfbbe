//! From a number of rooms to a floor plan: a hall in the middle, and a wing on either side.
//!
//! A wing begins with a spine, a corridor along its whole length. The rest of the wing is divided.
//! A large region is split by a corridor at right angles to the one that leads to it, a wide region
//! into strips. A region that is one room deep is cut into rooms, each with a door.

mod hall;

use rand::{Rng, SeedableRng, rngs::SmallRng, seq::IndexedRandom};

use super::{
    plan::{
        CEILING, OpeningKind, Plan, PlanDoor, PlanSpace, SpaceKind, WALL, WallOpening, WallSide,
    },
    rect::LatticeRect,
};

/// The width of a corridor.
const CORRIDOR: i32 = 144;
/// The greatest depth of a region that is cut into rooms.
const ROOM_DEPTH_MAX: i32 = 544;
/// The width of a strip: two rooms and a corridor between them.
const STRIP: i32 = 928;
/// The area of a wing for each room, corridors and walls included, in square units.
const ROOM_AREA: i64 = 38 * 64 * 64;
/// The width of a door.
const DOOR_WIDTH: i32 = 68;
/// The height of a door.
const DOOR_HEAD: i32 = 136;
/// The height of an arch.
const ARCH_HEAD: i32 = 176;
/// The least distance from an opening to the corner of a room.
const JAMB: i32 = 14;

/// Makes the plan for a number of rooms.
pub(super) fn plan(rooms: usize, seed: u64) -> Plan {
    let storeys = match rooms {
        0..=6 => 1,
        7..=20 => 2,
        21..=200 => 3,
        201..=600 => 4,
        601..=2000 => 6,
        _ => 8,
    };
    let mut layout = Layout::new(storeys, seed);
    if storeys == 1 {
        layout.cottage(rooms)
    } else {
        layout.wings_and_hall(rooms)
    }
    layout.windows();
    layout.plan
}

struct Layout {
    plan: Plan,
    rng: SmallRng,
    /// The storey, wing and hue of the spaces that are being made.
    storey: usize,
    wing: char,
    hue: f32,
    rooms_named: usize,
}

/// A part of a wing that is not divided yet.
#[derive(Clone, Copy)]
struct Region {
    rect: LatticeRect,
    /// The axis of the depth: at right angles to the corridor that leads here.
    axis: usize,
    /// Whether that corridor lies on the side of greater coordinates.
    at_max: bool,
    corridor: usize,
    rooms: usize,
}

impl Region {
    fn depth(&self) -> i32 {
        self.rect.size(self.axis)
    }

    fn length(&self) -> i32 {
        self.rect.size(1 - self.axis)
    }

    /// The piece of the wall towards the corridor with this extent along it.
    fn opening(&self, along: [i32; 2]) -> LatticeRect {
        let through = if self.at_max {
            [self.rect.max[self.axis], self.rect.max[self.axis] + WALL]
        } else {
            [self.rect.min[self.axis] - WALL, self.rect.min[self.axis]]
        };
        LatticeRect::spanning(self.axis, through, along)
    }
}

impl Layout {
    fn new(storeys: usize, seed: u64) -> Self {
        let plan = Plan {
            storeys,
            spaces: Vec::new(),
            doors: Vec::new(),
            stairs: Vec::new(),
            void: None,
            outlines: Vec::new(),
            blocks: vec![Vec::new(); storeys],
            openings: vec![Vec::new(); storeys],
        };
        let rng = SmallRng::seed_from_u64(seed);
        Self { plan, rng, storey: 0, wing: 'A', hue: 0.0, rooms_named: 0 }
    }

    /// Lays out one storey: a corridor, and rooms along it.
    fn cottage(&mut self, rooms: usize) {
        let (length, depth) = wing_size(rooms);
        let corridor = LatticeRect::new([0, 0], [length, CORRIDOR]);
        let rect = LatticeRect::new([0, -WALL - depth], [length, -WALL]);
        self.plan.outlines = vec![corridor.grown(WALL), rect.grown(WALL)];
        let corridor = self.space(
            "corridor".into(),
            SpaceKind::Corridor,
            corridor,
            WallSide { axis: 1, positive: true },
        );
        let middle = length / 2;
        let entrance = LatticeRect::new([middle - 48, CORRIDOR], [middle + 48, CORRIDOR + WALL]);
        self.door(entrance, 1, OpeningKind::Arch, (corridor, None));
        self.divide(Region { rect, axis: 1, at_max: true, corridor, rooms });
    }

    fn space(
        &mut self,
        name: String,
        kind: SpaceKind,
        rect: LatticeRect,
        accent: WallSide,
    ) -> usize {
        let hue = self.hue + self.rng.random_range(-0.09..0.09);
        let colours = match kind {
            SpaceKind::Room => [srgb(hue, 0.2, 0.95), srgb(hue, 0.8, 0.85)],
            _ => [srgb(self.hue, 0.05, 0.93), srgb(self.hue, 0.55, 0.8)],
        };
        self.plan.spaces.push(PlanSpace { name, kind, storey: self.storey, rect, colours, accent });
        self.plan.spaces.len() - 1
    }

    fn door(
        &mut self,
        rect: LatticeRect,
        axis: usize,
        kind: OpeningKind,
        spaces: (usize, Option<usize>),
    ) {
        let head = if kind == OpeningKind::Arch { ARCH_HEAD } else { DOOR_HEAD };
        self.plan.doors.push(PlanDoor { spaces, rect, storey: self.storey });
        self.plan.openings[self.storey].push(WallOpening { rect, axis, sill: 0, head, kind });
    }

    fn glaze(&mut self, rect: LatticeRect, axis: usize, sill: i32, head: i32) {
        let kind = OpeningKind::Glazed;
        self.plan.openings[self.storey].push(WallOpening { rect, axis, sill, head, kind });
    }

    fn divide(&mut self, region: Region) {
        let (depth, length) = (region.depth(), region.length());
        let strips = ((length + STRIP / 2) / STRIP) as usize;
        if depth <= ROOM_DEPTH_MAX || region.rooms < 2 || length < 3 * CORRIDOR {
            self.cut_into_rooms(region);
        } else if length >= 2 * STRIP && depth >= 3 * STRIP / 2 && region.rooms >= 8 {
            self.divide_by_corridor(region);
        } else if strips >= 2 && region.rooms >= 2 * strips {
            self.divide_into_strips(region, strips);
        } else {
            self.divide_by_corridor(region);
        }
    }

    /// Divides a region into strips side by side along the corridor.
    fn divide_into_strips(&mut self, region: Region, strips: usize) {
        let across = 1 - region.axis;
        let spans = self.cut(region.rect.span(across), strips, 0.12);
        let shares =
            share_out(region.rooms, &spans.iter().map(|s| s[1] - s[0]).collect::<Vec<_>>());
        for (span, rooms) in spans.into_iter().zip(shares) {
            self.divide(Region { rect: region.rect.with_span(across, span), rooms, ..region });
        }
    }

    /// Divides a region by a new corridor from the old one to the far end.
    fn divide_by_corridor(&mut self, region: Region) {
        let across = 1 - region.axis;
        let [start, end] = region.rect.span(across);
        let free = end - start - CORRIDOR;
        let one_sided = free < 2 * 260;
        let at = if one_sided {
            if self.rng.random_bool(0.5) { start } else { end - CORRIDOR }
        } else {
            start + free / 2 + self.rng.random_range(-free / 16..=free / 16)
        };
        let rect = region.rect.with_span(across, [at, at + CORRIDOR]);
        let name = format!("corridor {}{}{}", self.storey, self.wing, self.plan.spaces.len());
        let corridor = self.space(
            name,
            SpaceKind::Corridor,
            rect,
            WallSide { axis: region.axis, positive: region.at_max },
        );
        let opening = region.opening([at, at + CORRIDOR]);
        self.door(opening, region.axis, OpeningKind::Arch, (corridor, Some(region.corridor)));

        let sides = [([start, at - WALL], true), ([at + CORRIDOR + WALL, end], false)];
        let sides: Vec<_> =
            sides.into_iter().filter(|(span, _)| span[1] - span[0] > WALL).collect();
        let widths: Vec<i32> = sides.iter().map(|(span, _)| span[1] - span[0]).collect();
        for ((span, at_max), rooms) in sides.into_iter().zip(share_out(region.rooms, &widths)) {
            let rect = region.rect.with_span(across, span);
            self.divide(Region { rect, axis: across, at_max, corridor, rooms });
        }
    }

    /// Cuts a region into rooms side by side, each with a door to the corridor, some with one to
    /// the next room.
    fn cut_into_rooms(&mut self, region: Region) {
        let across = 1 - region.axis;
        let spans = self.cut(region.rect.span(across), region.rooms, 0.2);
        let mut previous = None;
        for span in spans {
            let rect = region.rect.with_span(across, span);
            let room = self.room(&region, rect);
            if let Some(previous) = previous
                && self.rng.random_bool(0.2)
            {
                self.connect(previous, room, rect, across);
            }
            previous = Some(room);
        }
    }

    fn room(&mut self, region: &Region, rect: LatticeRect) -> usize {
        let across = 1 - region.axis;
        let [start, end] = rect.span(across);
        self.rooms_named += 1;
        let name = format!("{}{}{:02}", self.storey, self.wing, self.rooms_named);
        let room = self.space(
            name,
            SpaceKind::Room,
            rect,
            WallSide { axis: region.axis, positive: region.at_max },
        );
        let at = self.rng.random_range(start + JAMB..=(end - JAMB - DOOR_WIDTH).max(start + JAMB));
        let door = region.opening([at, at + DOOR_WIDTH]);
        self.door(door, region.axis, OpeningKind::Door, (room, Some(region.corridor)));

        let before = [start + JAMB, at - 2 * JAMB];
        let after = [at + DOOR_WIDTH + 2 * JAMB, end - JAMB];
        let wider = if after[1] - after[0] > before[1] - before[0] { after } else { before };
        if wider[1] - wider[0] >= 64 && self.rng.random_bool(0.3) {
            let panel = [wider[0], wider[1].min(wider[0] + 128)];
            self.glaze(region.opening(panel), region.axis, 56, DOOR_HEAD);
        }
        room
    }

    /// Adds a door through the wall before `rect`, between two rooms that lie along `axis`.
    fn connect(&mut self, before: usize, after: usize, rect: LatticeRect, axis: usize) {
        let across = 1 - axis;
        let [start, end] = rect.span(across);
        let at = self.rng.random_range(start + JAMB..=(end - JAMB - DOOR_WIDTH).max(start + JAMB));
        let wall = [rect.min[axis] - WALL, rect.min[axis]];
        let door = LatticeRect::spanning(axis, wall, [at, at + DOOR_WIDTH]);
        self.door(door, axis, OpeningKind::Door, (before, Some(after)));
    }

    /// Cuts an extent into pieces with walls between. Each is up to `jitter` longer or shorter than
    /// the mean.
    fn cut(&mut self, span: [i32; 2], pieces: usize, jitter: f32) -> Vec<[i32; 2]> {
        let free = (span[1] - span[0] - WALL * (pieces as i32 - 1)) as f32;
        let weights: Vec<f32> =
            (0..pieces).map(|_| 1.0 + self.rng.random_range(-jitter..=jitter)).collect();
        let total: f32 = weights.iter().sum();
        let mut start = span[0];
        let mut spans: Vec<[i32; 2]> = Vec::with_capacity(pieces);
        for weight in weights {
            let end = start + (free * weight / total) as i32;
            spans.push([start, end]);
            start = end + WALL;
        }
        if let Some(last) = spans.last_mut() {
            last[1] = span[1];
        }
        spans
    }

    /// Adds windows to all outer walls.
    fn windows(&mut self) {
        for index in 0..self.plan.spaces.len() {
            let PlanSpace { rect, storey, kind, .. } = self.plan.spaces[index];
            self.storey = storey;
            let heights = match kind {
                SpaceKind::Room => {
                    *[(56, 160), (64, 144), (32, 160)].choose(&mut self.rng).unwrap_or(&(56, 160))
                }
                SpaceKind::Gallery => (16, ARCH_HEAD),
                SpaceKind::Corridor => (56, 152),
                SpaceKind::Stairs => continue,
            };
            for axis in 0..2 {
                let sides = [
                    [rect.min[axis] - WALL, rect.min[axis]],
                    [rect.max[axis], rect.max[axis] + WALL],
                ];
                for (through, out) in sides.into_iter().zip([-WALL, WALL]) {
                    self.window_row(axis, through, out, rect.span(1 - axis), heights);
                }
            }
        }
    }

    fn window_row(
        &mut self,
        axis: usize,
        through: [i32; 2],
        out: i32,
        along: [i32; 2],
        heights: (i32, i32),
    ) {
        let pitch_wanted = 168;
        let free = along[1] - along[0] - 2 * JAMB;
        let count = (free / pitch_wanted).max(1);
        let pitch = free / count;
        let width = (pitch - 40).min(112);
        if width < 40 {
            return;
        }
        for i in 0..count {
            let start = along[0] + JAMB + i * pitch + (pitch - width) / 2;
            let rect = LatticeRect::spanning(axis, through, [start, start + width]);
            let beyond = rect.with_span(axis, through.map(|v| v + out));
            let is_free =
                self.plan.openings[self.storey].iter().all(|o| !o.rect.overlaps(&rect.grown(8)));
            if self.plan.is_outside(&beyond) && is_free {
                self.glaze(rect, axis, heights.0, heights.1.min(CEILING));
            }
        }
    }
}

/// The length and the depth of a wing for a number of rooms.
fn wing_size(rooms: usize) -> (i32, i32) {
    let area = rooms as i64 * ROOM_AREA;
    let strips = ((area as f64).sqrt() * 1.2 / f64::from(STRIP)).round().max(1.0) as i32;
    let length = strips * STRIP;
    (length, ((area / i64::from(length)) as i32).max(ROOM_DEPTH_MAX * 3 / 5))
}

/// Shares a number out in proportion to weights, with at least one each when there are enough.
fn share_out(total: usize, weights: &[i32]) -> Vec<usize> {
    let sum: i64 = weights.iter().map(|&w| i64::from(w)).sum::<i64>().max(1);
    let mut left = total;
    let mut weight_left = sum;
    let mut shares = Vec::with_capacity(weights.len());
    for (i, &weight) in weights.iter().enumerate() {
        let after = weights.len() - i - 1;
        let exact = left as i64 * i64::from(weight) + weight_left / 2;
        let share = (exact / weight_left.max(1)) as usize;
        let share = if after == 0 {
            left
        } else {
            share.clamp(left.min(1), left.saturating_sub(after).max(left.min(1)))
        };
        shares.push(share);
        left -= share;
        weight_left -= i64::from(weight);
    }
    assert_eq!(shares.iter().sum::<usize>(), total, "nothing is lost");
    shares
}

/// A colour by hue (in turns), saturation and value.
pub(super) fn srgb(hue: f32, saturation: f32, value: f32) -> [u8; 3] {
    [5.0, 3.0, 1.0].map(|n: f32| {
        let k = (n + hue.rem_euclid(1.0) * 6.0) % 6.0;
        let dip = k.min(4.0 - k).clamp(0.0, 1.0);
        (255.0 * value * (1.0 - saturation * dip)) as u8
    })
}
