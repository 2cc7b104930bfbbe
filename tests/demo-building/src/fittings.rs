//! Fittings: steps, arches, glass, columns, balustrades, the landmark in the hall, and spawn
//! points.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::Vec3;

use super::{
    layout::srgb,
    mesh::{Face, Paint, Scene, metres},
    plan::{
        CEILING, OpeningKind, Plan, RISE, RUN, STEPS, STOREY, SpaceKind, Stair, WALL, WallOpening,
    },
    rect::LatticeRect,
};

const STEP: Paint = Paint::opaque([176, 172, 164]);
const FRAME: Paint = Paint::opaque([88, 92, 98]);
const RAIL: Paint = Paint::opaque([104, 74, 48]);
const STONE: Paint = Paint::opaque([226, 218, 200]);
/// The rise of an arch above its springing line.
const ARCH_RISE: i32 = 40;
const ARCH_SEGMENTS: i32 = 10;
/// The number of sides of a column.
const COLUMN_SIDES: u32 = 12;
const COLUMN_RADIUS_M: f32 = 0.28;
/// The least number of spawn points.
const SPAWNS_MIN: usize = 12;
/// The number of rooms on a storey with a spawn point.
const ROOM_SPAWNS_PER_STOREY: usize = 6;

/// Adds all fittings to the scene.
pub(super) fn build(plan: &Plan, scene: &mut Scene) {
    for stair in &plan.stairs {
        steps(plan, stair, scene);
    }
    for (storey, openings) in plan.openings.iter().enumerate() {
        let floor = plan.floor(storey);
        for opening in openings {
            match opening.kind {
                OpeningKind::Arch => arch(opening, floor, scene),
                OpeningKind::Glazed => glazing(opening, floor, scene),
                OpeningKind::Door => {}
            }
        }
    }
    if let Some(void) = &plan.void {
        hall(plan, void, scene);
    }
    spawns(plan, scene);
}

/// Adds treads and risers. The last riser is the edge of the upper floor.
fn steps(plan: &Plan, stair: &Stair, scene: &mut Scene) {
    let node = stair.spaces[0];
    let floor = plan.floor(stair.storey);
    let x = stair.flight.span(0);
    for step in 0..STEPS - 1 {
        let (z, riser) = if stair.towards_z {
            let z = stair.flight.min[1] + step * RUN;
            ([z, z + RUN], z)
        } else {
            let z = stair.flight.max[1] - step * RUN;
            ([z - RUN, z], z)
        };
        let (foot, top) = (floor + step * RISE, floor + (step + 1) * RISE);
        let tread = Face { axis: 1, at: top, min: [z[0], x[0]], max: [z[1], x[1]], positive: true };
        scene.face(node, STEP, tread);
        let (min, max) = ([x[0], foot], [x[1], top]);
        let positive = !stair.towards_z;
        scene.face(node, STEP, Face { axis: 2, at: riser, min, max, positive });
    }
}

/// The points of an opening: along its wall, up, and through it.
struct Frame<'a> {
    opening: &'a WallOpening,
    floor: i32,
}

impl Frame<'_> {
    fn along(&self) -> [i32; 2] {
        self.opening.rect.span(1 - self.opening.axis)
    }

    fn through(&self) -> [i32; 2] {
        self.opening.rect.span(self.opening.axis)
    }

    fn point(&self, along: f32, up: f32, through: i32) -> Vec3 {
        let up = metres(self.floor) + up;
        if self.opening.axis == 0 {
            Vec3::new(metres(through), up, along)
        } else {
            Vec3::new(along, up, metres(through))
        }
    }

    fn bar(&self, scene: &mut Scene, along: [i32; 2], up: [i32; 2], through: [i32; 2]) {
        let rect = LatticeRect::spanning(self.opening.axis, through, along);
        let floor = self.floor;
        let min = [rect.min[0], floor + up[0], rect.min[1]];
        scene.block(scene.shell(), FRAME, min, [rect.max[0], floor + up[1], rect.max[1]]);
    }
}

/// Fills the upper corners of an opening with spandrels, so that half an ellipse stays open.
fn arch(opening: &WallOpening, floor: i32, scene: &mut Scene) {
    let frame = Frame { opening, floor };
    let [start, end] = frame.along().map(metres);
    let (head, rise) = (metres(opening.head), metres(ARCH_RISE));
    let at = |i: i32| {
        let turn = PI * i as f32 / ARCH_SEGMENTS as f32;
        let along = (start + end) * 0.5 - (end - start) * 0.5 * turn.cos();
        let sides = i == 0 || i == ARCH_SEGMENTS;
        (along, if sides { head - rise } else { head - rise + rise * turn.sin() })
    };
    let shell = scene.shell();
    for i in 0..ARCH_SEGMENTS {
        let ((a, low), (b, high)) = (at(i), at(i + 1));
        let (a, b) = (if i == 0 { start } else { a }, if i + 1 == ARCH_SEGMENTS { end } else { b });
        for through in frame.through() {
            let corners = [
                frame.point(a, low, through),
                frame.point(b, high, through),
                frame.point(b, head, through),
                frame.point(a, head, through),
            ];
            scene.polygon(shell, STONE, &corners);
        }
        let [near, far] = frame.through();
        let soffit = [
            frame.point(a, low, near),
            frame.point(b, high, near),
            frame.point(b, high, far),
            frame.point(a, low, far),
        ];
        scene.polygon(shell, STONE, &soffit);
    }
}

/// Adds a pane in the middle of the wall, with a thin frame and mullions.
fn glazing(opening: &WallOpening, floor: i32, scene: &mut Scene) {
    let frame = Frame { opening, floor };
    let [near, far] = frame.through();
    let ([start, end], middle) = (frame.along(), (near + far) / 2);
    let (sill, head) = (opening.sill, opening.head);
    let depth = [middle - 3, middle + 3];
    frame.bar(scene, [start, end], [sill, sill + 4], depth);
    frame.bar(scene, [start, end], [head - 4, head], depth);
    let mullions = ((end - start) / 80).max(1);
    for i in 0..=mullions {
        let at = start + (end - start - 4) * i / mullions;
        frame.bar(scene, [at, at + 4], [sill + 4, head - 4], depth);
    }
    let [a, b] = [start, end].map(metres);
    let (low, high) = (metres(sill), metres(head));
    let corners = [(a, low), (b, low), (b, high), (a, high)];
    let pane = corners.map(|(along, up)| frame.point(along, up, middle));
    scene.polygon(scene.shell(), Paint::GLASS, &pane);
}

fn hall(plan: &Plan, void: &LatticeRect, scene: &mut Scene) {
    for storey in 0..plan.storeys {
        columns(void, plan.floor(storey), scene);
        if storey > 0 {
            balustrade(void, void.min[1], plan.floor(storey), scene);
            balustrade(void, void.max[1], plan.floor(storey), scene);
        }
    }
    skylight(void, plan.floor(plan.storeys), scene);
    landmark(void, plan.storeys, scene);
}

/// Two rows of round columns, just outside the edges of the galleries.
fn columns(void: &LatticeRect, floor: i32, scene: &mut Scene) {
    let count = (void.size(0) / 256).max(1);
    for i in 0..=count {
        let x = metres(void.min[0] + 40) + metres(void.size(0) - 80) * i as f32 / count as f32;
        for z in [metres(void.min[1] - 28), metres(void.max[1] + 28)] {
            let foot = Vec3::new(x, metres(floor), z);
            prism(scene, STONE, foot, COLUMN_RADIUS_M, COLUMN_RADIUS_M, metres(CEILING));
        }
    }
}

/// A twelve-sided column or cone, without its ends.
fn prism(scene: &mut Scene, paint: Paint, foot: Vec3, below: f32, above: f32, height: f32) {
    let at = |side: u32, radius: f32, up: f32| {
        let turn = (side as f32 + 0.5) / COLUMN_SIDES as f32 * TAU;
        foot + Vec3::new(radius * turn.sin(), up, radius * turn.cos())
    };
    for side in 0..COLUMN_SIDES {
        let corners = [
            at(side, below, 0.0),
            at(side + 1, below, 0.0),
            at(side + 1, above, height),
            at(side, above, height),
        ];
        scene.polygon(scene.shell(), paint, &corners);
    }
}

/// Adds a handrail on posts with glass below, along one edge of the void.
fn balustrade(void: &LatticeRect, z: i32, floor: i32, scene: &mut Scene) {
    let shell = scene.shell();
    let [start, end] = void.span(0);
    scene.block(shell, RAIL, [start, floor + 64, z - 3], [end, floor + 68, z + 3]);
    let posts = (end - start) / 96;
    for i in 0..=posts {
        let x = start + (end - start - 4) * i / posts;
        scene.block(shell, FRAME, [x, floor, z - 2], [x + 4, floor + 64, z + 2]);
    }
    let (min, max) = ([start, floor], [end, floor + 64]);
    scene.face(shell, Paint::GLASS, Face { axis: 2, at: z, min, max, positive: true });
}

/// Adds glass on beams over the hall.
fn skylight(void: &LatticeRect, roof: i32, scene: &mut Scene) {
    let shell = scene.shell();
    let beams = (void.size(0) / 128).max(1);
    for i in 0..=beams {
        let x = void.min[0] + (void.size(0) - 8) * i / beams;
        scene.block(shell, FRAME, [x, roof - 12, void.min[1]], [x + 8, roof, void.max[1]]);
    }
    let (min, max) = ([void.min[1], void.min[0]], [void.max[1], void.max[0]]);
    scene.face(shell, Paint::GLASS, Face { axis: 1, at: roof, min, max, positive: false });
}

/// Adds a striped column in the middle of the hall, as high as the building, with a disc at each
/// storey in the colour of its floor. It shows the storey from afar.
fn landmark(void: &LatticeRect, storeys: usize, scene: &mut Scene) {
    let [x, z] = void.centre();
    let shell = scene.shell();
    scene.block(shell, FRAME, [x - 48, 0, z - 48], [x + 48, 24, z + 48]);
    let stripes = storeys as i32 * 3;
    let height = metres(storeys as i32 * STOREY - 64) / stripes as f32;
    for i in 0..stripes {
        let foot = Vec3::new(metres(x), metres(24) + height * i as f32, metres(z));
        let paint = Paint::opaque(if i % 2 == 0 { [214, 48, 40] } else { [250, 246, 236] });
        let taper = |i: i32| 0.5 - 0.35 * i as f32 / stripes as f32;
        prism(scene, paint, foot, taper(i), taper(i + 1), height);
    }
    for storey in 1..storeys {
        let foot = Vec3::new(metres(x), metres(storey as i32 * STOREY) + 0.4, metres(z));
        let paint = Paint::opaque(srgb(0.06 + 0.27 * storey as f32, 0.85, 0.85));
        prism(scene, paint, foot, 0.5, 1.4, 0.35);
        prism(scene, paint, foot + Vec3::Y * 0.35, 1.4, 0.4, 0.25);
    }
}

/// Adds spawn points in the hall, on galleries, in corridors, and behind doors of rooms.
fn spawns(plan: &Plan, scene: &mut Scene) {
    for storey in 0..plan.storeys {
        let on_storey = plan.spaces.iter().filter(|space| space.storey == storey);
        for space in on_storey {
            let [x, z] = space.rect.centre();
            let long = usize::from(space.rect.size(1) > space.rect.size(0));
            let yaw = if long == 0 { FRAC_PI_2 } else { 0.0 };
            match space.kind {
                SpaceKind::Corridor => spawn(plan, storey, [x, z], yaw, scene),
                // The middle of a gallery lies over the void.
                SpaceKind::Gallery => {
                    let z = plan.void.map_or(z, |void| void.max[1] + 96);
                    spawn(plan, storey, [x + 40, z], 0.0, scene);
                    spawn(plan, storey, [x - 40, z], 0.0, scene);
                }
                _ => {}
            }
        }
        for door in plan.doors_on(storey).filter(|d| d.spaces.1.is_some()) {
            let room = &plan.spaces[door.spaces.0];
            if room.kind == SpaceKind::Room {
                let count = plan.room_count().div_ceil(plan.storeys).max(1);
                let nth = door.spaces.0 % count.div_ceil(ROOM_SPAWNS_PER_STOREY);
                if nth == 0 {
                    let (place, yaw) = behind(&door.rect, &room.rect);
                    spawn(plan, storey, place, yaw, scene);
                }
            }
        }
    }
    for i in 0.. {
        let Some(space) = plan.spaces.first().filter(|_| scene.spawn_count() < SPAWNS_MIN) else {
            break;
        };
        let along = space.rect.min[0] + 40 + (i * 56) % (space.rect.size(0) - 80).max(1);
        spawn(plan, 0, [along, space.rect.max[1] - 40], 0.0, scene);
    }
}

/// A place in a room half a metre behind its door, and the yaw that looks into the room.
fn behind(door: &LatticeRect, room: &LatticeRect) -> ([i32; 2], f32) {
    let [x, z] = door.centre();
    let step = WALL / 2 + 36;
    if door.min[0] >= room.max[0] {
        ([room.max[0] - step, z], FRAC_PI_2)
    } else if door.max[0] <= room.min[0] {
        ([room.min[0] + step, z], -FRAC_PI_2)
    } else if door.min[1] >= room.max[1] {
        ([x, room.max[1] - step], 0.0)
    } else {
        ([x, room.min[1] + step], PI)
    }
}

fn spawn(plan: &Plan, storey: usize, [x, z]: [i32; 2], yaw: f32, scene: &mut Scene) {
    scene.spawn(Vec3::new(metres(x), metres(plan.floor(storey)), metres(z)), yaw);
}
