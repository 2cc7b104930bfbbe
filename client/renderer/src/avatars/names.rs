//! Names above the heads of figures. No two of them overlap, and none covers a nearer head.

use super::{
    super::{Frame, text, view::View},
    AvatarFigure, NAME_ABOVE_M,
    figure::{self, Part},
};

/// A nearer name is left out, in metres: there is no room for it.
const FROM_M: f32 = 0.3;
/// A name farther away is left out, in metres: it could not be read.
const WITHIN_M: f32 = 40.0;
/// The number of letters of a name that are shown.
const LETTERS_MAX: usize = 24;
/// The number of names that are shown, those of the nearest.
const NAMES_MAX: usize = 48;
/// How many obstacles a name gives way to before it is left out.
const MOVES_MAX: usize = 6;
/// The free pixels between two names, at scale 1.
const GAP: i32 = 2;

/// A rectangle of pixels: its upper left corner, and the pixel beyond its lower right one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Area {
    min: [i32; 2],
    max: [i32; 2],
}

impl Area {
    fn overlaps(&self, other: &Self) -> bool {
        (0..2).all(|axis| self.min[axis] < other.max[axis] && other.min[axis] < self.max[axis])
    }
}

/// A name before it has its place.
#[derive(Clone, Copy, Debug)]
struct Label {
    /// The pixel under the middle of its lower edge.
    anchor: [i32; 2],
    /// Width and height in pixels.
    size: [i32; 2],
    /// The head that it belongs to.
    head: Area,
    gap: i32,
}

/// Finds places for labels, those of the nearest figures first, in a picture of this width and
/// height. A label is above its head, or higher where another label or a nearer head is in the way.
/// `None` for labels that find no place.
fn places(labels: &[Label], picture: [i32; 2]) -> Vec<Option<Area>> {
    let mut taken: Vec<Area> = Vec::new();
    let place = |label: &Label| {
        taken.push(label.head);
        let found = free_place(label, picture, &taken);
        taken.extend(found);
        found
    };
    labels.iter().map(place).collect()
}

fn free_place(label: &Label, picture: [i32; 2], taken: &[Area]) -> Option<Area> {
    let Label { anchor, size, gap, .. } = *label;
    let left = (anchor[0] - size[0] / 2).min(picture[0] - size[0]).max(0);
    let mut lower = anchor[1];
    for _ in 0..=MOVES_MAX {
        let area = Area { min: [left, lower - size[1]], max: [left + size[0], lower] };
        if area.min[1] < 0 || area.max[0] > picture[0] || area.max[1] > picture[1] {
            return None;
        }
        match taken.iter().filter(|other| area.overlaps(other)).map(|other| other.min[1]).min() {
            None => return Some(area),
            Some(top) => lower = top - gap,
        }
    }
    None
}

/// Writes the names of figures that can be seen above their heads.
pub(super) fn draw(frame: &mut Frame, view: &View, figures: &[&AvatarFigure]) {
    let mut named: Vec<(f32, &AvatarFigure, Label)> =
        figures.iter().filter_map(|figure| label(frame, view, figure)).collect();
    named.sort_by(|a, b| a.0.total_cmp(&b.0));
    named.truncate(NAMES_MAX);
    let labels: Vec<Label> = named.iter().map(|(_, _, label)| *label).collect();
    let places = places(&labels, [frame.width() as i32, frame.height() as i32]);
    for ((depth, figure, _), place) in named.iter().zip(places) {
        let Some(Area { min: [x, y], max }) = place else { continue };
        let scale = scale(view, *depth);
        let (pad, wide) = (scale as i32, (max[0] - x) as usize);
        text::darken(frame, [x, y], [wide, (max[1] - y) as usize]);
        let [r, g, b] = figure.colour;
        let colour = u32::from_be_bytes([0, r, g, b]);
        text::fill(frame, [x, max[1] - pad], [wide, scale], colour);
        text::draw(frame, [x + 2 * pad, y + pad], scale, 0x00ff_ffff, &shown(figure));
    }
}

/// The depth of a figure's name and its label; `None` where there is no name to show.
fn label<'a>(
    frame: &Frame,
    view: &View,
    figure: &&'a AvatarFigure<'a>,
) -> Option<(f32, &'a AvatarFigure<'a>, Label)> {
    let Part { centre, shape, .. } = figure::head(figure);
    let above = figure.pose.eye + glam::Vec3::Y * (figure.body.above_eye + NAME_ABOVE_M);
    let at = view.project(above);
    let is_near = at.z > FROM_M && at.z < WITHIN_M && at.abs().max_element() < 1.0e6;
    if figure.name.is_empty() || !is_near {
        return None;
    }
    let half = (view.project(centre) - at).y.max(1.0) as i32;
    let wide = (shape.x_axis.length() * view.focal() / at.z) as i32;
    let [x, y] = [at.x as i32, at.y as i32];
    let scale = scale(view, at.z);
    let width = text::width(&shown(figure), scale) + 4 * scale;
    let size = [width as i32, ((text::LETTER + 3) * scale) as i32];
    // The name of a head that reaches beyond the upper edge is written on it.
    let lower = y.max(size[1]);
    let head = Area { min: [x - wide, lower + 1], max: [x + wide, lower.max(y + 2 * half)] };
    if !head.overlaps(&Area { min: [0; 2], max: [frame.width() as i32, frame.height() as i32] }) {
        return None;
    }
    let gap = GAP * scale as i32;
    Some((at.z, figure, Label { anchor: [x, lower], size, head, gap }))
}

fn shown(figure: &AvatarFigure) -> String {
    figure.name.chars().take(LETTERS_MAX).collect()
}

/// The scale of a name at a depth in metres: pixels of the picture for each pixel of a letter.
fn scale(view: &View, depth: f32) -> usize {
    ((view.focal() * 0.012 / depth).round() as usize).clamp(1, 3)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const PICTURE: [i32; 2] = [400, 300];

    fn label() -> impl Strategy<Value = Label> {
        let at = (-40..440, -20..330);
        (at, 8..220, 1..4).prop_map(|((x, y), width, scale)| {
            let head = Area { min: [x - 9, y + 1], max: [x + 9, y + 22] };
            Label { anchor: [x, y], size: [width, 11 * scale], head, gap: GAP * scale }
        })
    }

    /// The pixels of an area.
    fn pixels(area: &Area) -> impl Iterator<Item = [i32; 2]> + use<> {
        let Area { min, max } = *area;
        (min[1]..max[1]).flat_map(move |y| (min[0]..max[0]).map(move |x| [x, y]))
    }

    proptest! {
        #[test]
        fn no_pixel_has_two_names_or_a_name_and_a_nearer_head(
            labels in prop::collection::vec(label(), 0..40),
        ) {
            let places = places(&labels, PICTURE);
            let mut owners = std::collections::HashMap::new();
            for (i, (label, place)) in labels.iter().zip(&places).enumerate() {
                let Some(area) = place else { continue };
                prop_assert_eq!([area.max[0] - area.min[0], area.max[1] - area.min[1]], label.size);
                prop_assert!(area.max[1] <= label.anchor[1], "above its head");
                for pixel in pixels(area) {
                    prop_assert!((0..2).all(|axis| (0..PICTURE[axis]).contains(&pixel[axis])));
                    prop_assert_eq!(owners.insert(pixel, i), None, "{:?}", pixel);
                }
                for nearer in &labels[..i] {
                    prop_assert!(pixels(&nearer.head).all(|pixel| owners.get(&pixel) != Some(&i)));
                }
            }
            // A name that has its place to itself gets it.
            if let Some(label) = labels.first()
                && (label.size[1]..=PICTURE[1]).contains(&label.anchor[1])
            {
                prop_assert_eq!(places[0].map(|area| area.max[1]), Some(label.anchor[1]));
            }
        }
    }

    #[test]
    fn names_of_people_behind_each_other_are_stacked() {
        let head = Area { min: [190, 101], max: [210, 120] };
        let label = Label { anchor: [200, 100], size: [60, 11], head, gap: 2 };
        let lower: Vec<Option<i32>> =
            places(&[label; 9], PICTURE).iter().map(|at| at.map(|area| area.max[1])).collect();
        let expected: Vec<Option<i32>> =
            (0..9).map(|i| (i <= MOVES_MAX as i32).then_some(100 - 13 * i)).collect();
        assert_eq!(lower, expected);
    }
}
