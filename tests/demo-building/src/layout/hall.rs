//! The hall, its galleries and staircases, and the wings on either side.

use rand::Rng;

use super::{
    super::{
        plan::{OpeningKind, PlanSpace, RUN, STEPS, SpaceKind, Stair, WALL, WallSide},
        rect::LatticeRect,
    },
    CORRIDOR, DOOR_WIDTH, JAMB, Layout, Region, share_out, wing_size,
};

/// The width of a gallery.
const GALLERY: i32 = 160;
/// The width of a flight of steps.
const LANE: i32 = 80;
/// The length of a flight: its last step is the upper floor.
const FLIGHT: i32 = (STEPS - 1) * RUN;
/// The depth of a landing.
const LANDING: i32 = 96;
/// The size of a staircase between its walls.
const CORE_SIZE: [i32; 2] = [2 * LANE + WALL, FLIGHT + 2 * LANDING];

impl Layout {
    /// Lays out several storeys: a hall with two staircases, and wings to the west and to the east.
    pub(super) fn wings_and_hall(&mut self, rooms: usize) {
        let storeys = self.plan.storeys;
        let rooms_of = |storey: usize| rooms * (storey + 1) / storeys - rooms * storey / storeys;
        let busiest = (0..storeys).map(rooms_of).max().unwrap_or(1);
        let west_share = self.rng.random_range(40..=60);
        let shares = [west_share, 100 - west_share];
        let sizes = share_out(busiest, &shares).into_iter().map(wing_size).collect::<Vec<_>>();

        let void_width = 640 + 64 * (busiest as i32 / 24).min(10);
        let hall = hall_rect(void_width);
        let wings: Vec<LatticeRect> = sizes
            .iter()
            .enumerate()
            .map(|(east, &(length, depth))| self.place_wing(east == 1, length, depth, &hall))
            .collect();
        self.plan.outlines.push(hall.grown(WALL));
        self.plan.outlines.extend(wings.iter().map(|wing| wing.grown(WALL)));
        let core_width = CORE_SIZE[0] + 2 * WALL;
        self.plan.void = Some(LatticeRect::new(
            [GALLERY + core_width, GALLERY],
            [GALLERY + core_width + void_width, hall.max[1] - GALLERY],
        ));
        for storey in 0..storeys {
            self.storey = storey;
            self.rooms_named = 0;
            let gallery = self.hall(hall);
            let counts = share_out(rooms_of(storey), &shares);
            for (east, (wing, rooms)) in wings.iter().zip(counts).enumerate() {
                self.wing(east == 1, *wing, &hall, gallery, rooms);
            }
        }
    }

    /// The place of a wing: beside the hall, shifted along it.
    fn place_wing(
        &mut self,
        east: bool,
        length: i32,
        depth: i32,
        hall: &LatticeRect,
    ) -> LatticeRect {
        let slack = (length / 3).min(256);
        let middle = hall.centre()[1] - length / 2;
        let z = middle + self.rng.random_range(-slack..=slack);
        let width = CORRIDOR + WALL + depth;
        let x = if east { hall.max[0] + WALL } else { -WALL - width };
        LatticeRect::new([x, z], [x + width, z + length])
    }

    /// Adds the hall on one storey, and gives the index of its space.
    fn hall(&mut self, hall: LatticeRect) -> usize {
        (self.wing, self.hue) = ('H', 0.12);
        let name = format!("{} {}", if self.storey == 0 { "hall" } else { "gallery" }, self.storey);
        let gallery =
            self.space(name, SpaceKind::Gallery, hall, WallSide { axis: 1, positive: true });
        if self.storey == 0 {
            let middle = hall.centre()[0];
            let entrance =
                LatticeRect::new([middle - 64, hall.max[1]], [middle + 64, hall.max[1] + WALL]);
            self.door(entrance, 1, OpeningKind::Arch, (gallery, None));
        }
        for east in [false, true] {
            self.staircase(east, &hall, gallery);
        }
        gallery
    }

    /// Adds a staircase on one storey. Flights alternate between two lanes, with landings at both
    /// ends. People arrive and leave at the same end, so the other end is walled up.
    fn staircase(&mut self, east: bool, hall: &LatticeRect, gallery: usize) {
        let x = if east { hall.max[0] - GALLERY - WALL - CORE_SIZE[0] } else { GALLERY + WALL };
        let z = GALLERY + WALL;
        let core = LatticeRect::new([x, z], [x + CORE_SIZE[0], z + CORE_SIZE[1]]);
        let even = self.storey.is_multiple_of(2);
        let landings = [[z, z + LANDING], [core.max[1] - LANDING, core.max[1]]];
        let (landing, walled_up) =
            if even { (landings[0], landings[1]) } else { (landings[1], landings[0]) };

        let outer = core.grown(WALL);
        let flights = [z + LANDING, z + LANDING + FLIGHT];
        self.plan.blocks[self.storey].extend([
            outer.with_span(0, [outer.min[0], core.min[0]]),
            outer.with_span(0, [core.max[0], outer.max[0]]),
            core.with_span(1, [outer.min[1], core.min[1]]),
            core.with_span(1, [core.max[1], outer.max[1]]),
            core.with_span(1, walled_up),
            LatticeRect::new([x + LANE, flights[0]], [x + LANE + WALL, flights[1]]),
        ]);
        let name = format!("stairs {}{}", self.storey, if east { 'E' } else { 'W' });
        let space = self.space(name, SpaceKind::Stairs, core, WallSide { axis: 1, positive: even });

        let towards_gallery = [outer.min[0], core.min[0]];
        let towards_void = [core.max[0], outer.max[0]];
        let (entry, view) =
            if east { (towards_void, towards_gallery) } else { (towards_gallery, towards_void) };
        let at = landing[0] + JAMB;
        let door = LatticeRect::new([entry[0], at], [entry[1], at + DOOR_WIDTH]);
        self.door(door, 0, OpeningKind::Door, (space, Some(gallery)));
        let panel = LatticeRect::new([view[0], flights[0] + 32], [view[1], flights[1] - 32]);
        self.glaze(panel, 0, 64, 176);
        self.flight_below(&core, flights, space);
    }

    /// Adds the flight that arrives from the storey below, if there is one.
    fn flight_below(&mut self, core: &LatticeRect, span: [i32; 2], upper: usize) {
        let Some(storey) = self.storey.checked_sub(1) else { return };
        let below = |space: &PlanSpace| space.storey == storey && space.rect == *core;
        let Some(lower) = self.plan.spaces.iter().position(below) else { return };
        let towards_z = storey.is_multiple_of(2);
        let x = core.min[0] + if towards_z { 0 } else { LANE + WALL };
        let flight = LatticeRect::new([x, span[0]], [x + LANE, span[1]]);
        self.plan.stairs.push(Stair { spaces: [lower, upper], flight, towards_z, storey });
    }

    /// Adds one storey of a wing: its spine, and the rooms beyond.
    fn wing(
        &mut self,
        east: bool,
        wing: LatticeRect,
        hall: &LatticeRect,
        gallery: usize,
        rooms: usize,
    ) {
        (self.wing, self.hue) = if east { ('E', 0.58) } else { ('W', 0.04) };
        self.hue += 0.13 * self.storey as f32;
        let (spine, rest, through) = if east {
            let x = wing.min[0] + CORRIDOR;
            ([wing.min[0], x], [x + WALL, wing.max[0]], [hall.max[0], hall.max[0] + WALL])
        } else {
            let x = wing.max[0] - CORRIDOR;
            ([x, wing.max[0]], [wing.min[0], x - WALL], [hall.min[0] - WALL, hall.min[0]])
        };
        let name = format!("spine {}{}", self.storey, self.wing);
        let corridor = self.space(
            name,
            SpaceKind::Corridor,
            wing.with_span(0, spine),
            WallSide { axis: 0, positive: !east },
        );
        let width = 112;
        let shared = [wing.min[1].max(hall.min[1]) + JAMB, wing.max[1].min(hall.max[1]) - JAMB];
        let at = self.rng.random_range(shared[0]..=(shared[1] - width).max(shared[0]));
        let opening = LatticeRect::new([through[0], at], [through[1], at + width]);
        self.door(opening, 0, OpeningKind::Arch, (corridor, Some(gallery)));
        let rect = wing.with_span(0, rest);
        self.divide(Region { rect, axis: 0, at_max: !east, corridor, rooms });
    }
}

fn hall_rect(void_width: i32) -> LatticeRect {
    let core = [CORE_SIZE[0] + 2 * WALL, CORE_SIZE[1] + 2 * WALL];
    LatticeRect::new([0, 0], [2 * (GALLERY + core[0]) + void_width, 2 * GALLERY + core[1]])
}
