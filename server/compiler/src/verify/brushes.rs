//! The brushes of a map in a grid: whether a point lies inside a brush.

use std::ops::Range;

use glam::Vec3;
use sightline_world::tolerance::BRUSH_CORNER_M;
use sightline_world::{Origin, OriginPlane, geometry::Aabb};

/// The edge of a field of the grid, in metres; larger where the grid would have more fields than
/// [`FIELDS_MAX`].
const FIELD_M: f32 = 0.5;
/// The most fields of a grid.
const FIELDS_MAX: f32 = 2e6;
/// The most references from fields to brushes: 64 MiB. Further brushes are tested everywhere.
const REFERENCES_MAX: usize = 1 << 24;
/// The brushes of a map, in a grid.
pub(super) struct Brushes {
    bounds: Aabb,
    fields_per_m: f32,
    size: [usize; 3],
    /// For each field, the brushes whose boxes touch it.
    fields: Vec<Vec<u32>>,
    /// Brushes that are tested everywhere.
    everywhere: Vec<u32>,
    brushes: Vec<Brush>,
    planes: Vec<OriginPlane>,
}

struct Brush {
    bounds: Aabb,
    sides: Range<u32>,
}

impl Brushes {
    /// The brushes of a map within some bounds.
    pub(super) fn new(origin: &Origin, bounds: &Aabb) -> Self {
        let size = bounds.size();
        let field = FIELD_M.max((size.element_product() / FIELDS_MAX).cbrt());
        let size = size.to_array().map(|side| (side / field) as usize + 1);
        let mut all = Self {
            bounds: *bounds,
            fields_per_m: 1.0 / field,
            size,
            fields: vec![Vec::new(); size.iter().product()],
            everywhere: Vec::new(),
            brushes: Vec::new(),
            planes: Vec::new(),
        };
        let mut references = 0;
        for (index, solid) in (0..).zip(&origin.solids) {
            let bounds = solid.bounds.grown(BRUSH_CORNER_M);
            let first = all.planes.len() as u32;
            all.planes.extend(origin.sides(solid));
            all.brushes.push(Brush { bounds, sides: first..all.planes.len() as u32 });
            let fields = all.fields_of(&bounds);
            references += fields.len();
            if references > REFERENCES_MAX {
                all.everywhere.push(index);
                continue;
            }
            for field in fields {
                all.fields[field].push(index);
            }
        }
        all
    }

    /// Whether a brush holds a point, when every brush is made `larger` metres larger.
    pub(super) fn hold(&self, point: Vec3, larger: f64) -> bool {
        let here = &self.fields[self.index(self.field(point))];
        here.iter().chain(&self.everywhere).any(|&index| {
            let Brush { bounds, sides } = &self.brushes[index as usize];
            let sides = sides.start as usize..sides.end as usize;
            let point = bounds.contains(point).then(|| point.as_dvec3());
            point.is_some_and(|p| self.planes[sides].iter().all(|side| side.height(p) < larger))
        })
    }

    fn fields_of(&self, region: &Aabb) -> Vec<usize> {
        let (low, high) = (self.field(region.min), self.field(region.max));
        let mut fields = Vec::new();
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                fields.extend((low[0]..=high[0]).map(|x| self.index([x, y, z])));
            }
        }
        fields
    }

    /// The field of a point, or the nearest field to it.
    fn field(&self, point: Vec3) -> [usize; 3] {
        let at = ((point - self.bounds.min) * self.fields_per_m).to_array();
        // The conversion to usize turns negative numbers into 0.
        std::array::from_fn(|axis| (at[axis] as usize).min(self.size[axis] - 1))
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        debug_assert!(x < self.size[0] && y < self.size[1] && z < self.size[2]);
        (z * self.size[1] + y) * self.size[0] + x
    }
}
