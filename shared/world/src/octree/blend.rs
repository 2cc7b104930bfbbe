//! The materials of inner nodes: the mean of the leaves below, taken in linear light.

use std::ops::Range;

use super::{
    InnerNode, Material, flat, layout,
    palette::{Palette, unit},
};

/// Gives every inner node its flags and the mean material of the leaves below it. The same leaves
/// and palette give the same result on every machine, bit for bit.
///
/// `None` when the palette has no room for a mean.
pub(super) fn average(
    inner: &mut [InnerNode],
    roots: &Range<usize>,
    leaves: &[u16],
    depth: u8,
    palette: &mut Palette,
) -> Option<()> {
    let mut weights = vec![0u32; roots.end];
    let mut blends = Vec::new();
    for root in roots.clone() {
        let block = layout::block(inner, roots, root, depth);
        let start = block.nodes.start;
        blends.clear();
        blends.resize(block.nodes.len(), Blend::default());
        for index in block.nodes.rev().chain([root]) {
            let node = inner[index];
            let mut blend = Children::default();
            for child in node.first as usize..(node.first + node.mask.count_ones()) as usize {
                if index >= block.bottom {
                    let leaf = leaves[child];
                    blend.add(leaf, Blend::of(&palette.materials[usize::from(leaf)], 1), false);
                } else {
                    let child_node = &inner[child];
                    let glassy = child_node.flags & InnerNode::SOME_GLASS != 0;
                    blend.add(child_node.material, blends[child - start], glassy);
                }
            }
            let blend = blend.finish(&mut inner[index], palette)?;
            inner[index].flags |= flat::flags(inner, index, block.bottom);
            match index.checked_sub(start) {
                Some(place) => blends[place] = blend,
                None => weights[root] = blend.weight,
            }
        }
    }
    for index in (0..roots.start).rev() {
        let node = inner[index];
        let mut blend = Children::default();
        for child in node.first as usize..(node.first + node.mask.count_ones()) as usize {
            let InnerNode { material, flags, .. } = inner[child];
            let mean = Blend::of(&palette.materials[usize::from(material)], weights[child]);
            blend.add(material, mean, flags & InnerNode::SOME_GLASS != 0);
        }
        weights[index] = blend.finish(&mut inner[index], palette)?.weight;
    }
    Some(())
}

/// Sums over the children of one node.
#[derive(Default)]
struct Children {
    opaque: Blend,
    glass: Blend,
    some_glass: bool,
    material: Option<u16>,
    differ: bool,
}

impl Children {
    fn add(&mut self, material: u16, mean: Blend, some_glass: bool) {
        self.differ |= self.material.is_some_and(|first| first != material);
        self.material = Some(material);
        self.some_glass |= some_glass || mean.is_glass;
        if mean.is_glass {
            self.glass.add(&mean);
        } else {
            self.opaque.add(&mean);
        }
    }

    /// Sets the node's material and flags. Glass does not change the material of a node that has an
    /// opaque leaf too. `None` when the palette has no room.
    fn finish(self, node: &mut InnerNode, palette: &mut Palette) -> Option<Blend> {
        let is_glass = self.opaque.weight == 0;
        let blend = if is_glass { Blend { is_glass, ..self.glass } } else { self.opaque };
        node.material = match self.material {
            // Rounding must not change the common material of all children.
            Some(material) if !self.differ => material,
            _ => palette.index(&blend.material())?,
        };
        node.flags = if is_glass { InnerNode::GLASS } else { 0 };
        node.flags |= if self.some_glass { InnerNode::SOME_GLASS } else { 0 };
        Some(blend)
    }
}

/// A weighted mean of materials.
#[derive(Clone, Copy, Default)]
struct Blend {
    is_glass: bool,
    weight: u32,
    /// The weighted sums of squared sRGB values: close to sums of light, and exact.
    light: [u64; 3],
    normal: [i64; 3],
}

impl Blend {
    fn of(material: &Material, weight: u32) -> Self {
        let light = material.colour.map(|channel| u64::from(weight) * u64::from(channel).pow(2));
        let normal = material.normal.map(|part| i64::from(weight) * i64::from(part));
        Self { is_glass: material.is_glass(), weight, light, normal }
    }

    fn add(&mut self, other: &Self) {
        self.weight = self.weight.saturating_add(other.weight);
        for (sum, light) in self.light.iter_mut().zip(other.light) {
            *sum += light;
        }
        // The two sides of a thin wall must not cancel out.
        let along: f64 =
            self.normal.iter().zip(other.normal).map(|(&a, b)| a as f64 * b as f64).sum();
        let sign = if along < 0.0 { -1 } else { 1 };
        for (sum, part) in self.normal.iter_mut().zip(other.normal) {
            *sum += sign * part;
        }
    }

    fn material(&self) -> Material {
        let weight = f64::from(self.weight.max(1));
        // A root is exactly rounded, so that all machines agree.
        let colour = self.light.map(|sum| ((sum as f64 / weight).sqrt() + 0.5) as u8);
        let normal = unit(self.normal.map(|part| part as f64));
        Material { colour, normal, flags: if self.is_glass { Material::GLASS } else { 0 } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_averaged_and_not_srgb() {
        let mut blend = Blend::default();
        for shade in [0, 255] {
            blend.add(&Blend::of(&Material { colour: [shade; 3], ..Material::default() }, 1));
        }
        assert_eq!(blend.material().colour, [180; 3]);
    }

    #[test]
    fn opposite_normals_do_not_cancel() {
        let mut blend = Blend::default();
        for x in [127, -127] {
            blend.add(&Blend::of(&Material { normal: [x, 0, 0], ..Material::default() }, 1));
        }
        assert_eq!(blend.material().normal, [127, 0, 0]);
    }
}
