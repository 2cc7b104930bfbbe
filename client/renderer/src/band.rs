//! A band of the picture while it is drawn: what each pixel shows, and the mask buffer.

use super::{
    hull::Hull,
    layer::Layer,
    mask::{Area, BLOCK, Mask, bits, lines},
    view::BandView,
};

/// The number of rows of a band: whole blocks.
pub(super) const BAND_ROWS: usize = 136;

const _: () = assert!(BAND_ROWS.is_multiple_of(BLOCK));

/// The number of pixels in a block.
const PIXELS: usize = BLOCK * BLOCK;

/// The bits of each byte, one by one.
const LINES_WANTED: [[u8; BLOCK]; 256] = {
    let mut lines = [[0; BLOCK]; 256];
    let mut i = 0;
    while i < 256 * BLOCK {
        lines[i / BLOCK][i % BLOCK] = (((i / BLOCK) >> (i % BLOCK)) & 1) as u8;
        i += 1;
    }
    lines
};

/// Some rows of the picture, in blocks of 8 × 8 pixels.
#[derive(Default)]
pub(super) struct Band {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) mask: Mask,
    /// The material that each pixel of a block shows, where it is written.
    pub(super) material_ids: Vec<[u16; PIXELS]>,
    /// The depth of what each pixel shows in metres, where it is written.
    pub(super) depths: Vec<[f32; PIXELS]>,
    /// The pixels of each block that have glass in front, as masks.
    pub(super) tinted: Vec<u64>,
    /// The material of the glass in front of each pixel, and its depth.
    pub(super) glass: Vec<[u16; PIXELS]>,
    pub(super) glass_depths: Vec<[f32; PIXELS]>,
    /// The number of pixels written.
    pub(super) pixels: u64,
}

impl Band {
    /// Begins a band of this size in which nothing is written.
    pub(super) fn clear(&mut self, width: usize, height: usize) {
        assert!(height <= BAND_ROWS, "{height} rows");
        (self.width, self.height) = (width, height);
        self.mask.clear(width, height);
        let blocks = width.div_ceil(BLOCK) * height.div_ceil(BLOCK);
        self.material_ids.resize(blocks, [0; PIXELS]);
        self.depths.resize(blocks, [0.0; PIXELS]);
        self.tinted.clear();
        self.tinted.resize(blocks, 0);
        self.glass.resize(blocks, [0; PIXELS]);
        self.glass_depths.resize(blocks, [0.0; PIXELS]);
        self.pixels = 0;
    }

    /// The part of some columns and rows that lies in the band; none when it is empty. The second
    /// of each two numbers lies outside.
    #[inline(always)]
    pub(super) fn clip(&self, [columns, rows]: [[i32; 2]; 2]) -> Option<Area> {
        let [left, right] = [columns[0].max(0), columns[1].min(self.width as i32)];
        let [top, bottom] = [rows[0].max(0), rows[1].min(self.height as i32)];
        (left < right && top < bottom).then_some(Area {
            left: left as usize,
            right: right as usize,
            top: top as usize,
            bottom: bottom as usize,
        })
    }

    /// Writes the pixels of an area that are within an outline and open. Glass tints them instead.
    #[inline(always)]
    pub(super) fn fill(
        &mut self,
        area: &Area,
        hull: &Hull,
        material_id: u16,
        depth: f32,
        glass: bool,
    ) {
        let [columns, rows] = area.blocks();
        for row in rows {
            let ends = hull.rows(area, row);
            for column in columns.clone() {
                let block = row * self.mask.across() + column;
                let open = ends.word(column) & !self.mask.word(block);
                if open == 0 {
                    continue;
                }
                if glass {
                    self.tint(block, open, material_id, depth);
                } else {
                    self.write(block, open, material_id, depth);
                }
            }
        }
    }

    /// Writes the open pixels of an area that show a layer of voxels with these materials. A layer
    /// of glass is put in front of those that have no glass yet.
    #[inline(always)]
    pub(super) fn fill_layer<const GLASS: bool>(
        &mut self,
        view: &BandView,
        area: &Area,
        layer: &Layer,
        material_ids: &[u16],
    ) {
        let [columns, rows] = area.blocks();
        for row in rows {
            let ends = layer.outline().rows(area, row);
            for column in columns.clone() {
                let block = row * self.mask.across() + column;
                let mut open = ends.word(column) & !self.mask.word(block);
                if GLASS {
                    open &= !self.tinted[block];
                }
                if open == 0 {
                    continue;
                }
                let to = if GLASS { &mut self.glass[block] } else { &mut self.material_ids[block] };
                let depths =
                    if GLASS { &mut self.glass_depths[block] } else { &mut self.depths[block] };
                for y in bits(lines(open)) {
                    let wanted = LINES_WANTED[(open >> (BLOCK * y)) as usize & 0xff];
                    let (voxels, line_depths) =
                        layer.voxels(view, [column * BLOCK, row * BLOCK + y], &wanted);
                    let line_ids = voxels.map(|voxel| material_ids[voxel as usize]);
                    // All pixels of the line are assigned, so that there is no branch.
                    for x in 0..BLOCK {
                        let pixel = BLOCK * y + x;
                        let is_wanted = wanted[x] != 0;
                        to[pixel] = if is_wanted { line_ids[x] } else { to[pixel] };
                        depths[pixel] = if is_wanted { line_depths[x] } else { depths[pixel] };
                    }
                }
                if GLASS {
                    self.tinted[block] |= open;
                } else {
                    self.pixels += u64::from(open.count_ones());
                    self.mask.cover(block, open);
                }
            }
        }
    }

    /// Writes pixels of a block that are open.
    #[inline(always)]
    fn write(&mut self, block: usize, pixels: u64, material_id: u16, depth: f32) {
        if pixels == !0 {
            self.material_ids[block] = [material_id; PIXELS];
            self.depths[block] = [depth; PIXELS];
        } else {
            let (material_ids, depths) = (&mut self.material_ids[block], &mut self.depths[block]);
            for pixel in bits(pixels) {
                material_ids[pixel] = material_id;
                depths[pixel] = depth;
            }
        }
        self.pixels += u64::from(pixels.count_ones());
        self.mask.cover(block, pixels);
    }

    /// Puts glass in front of those pixels of a block that have none yet.
    #[inline(never)]
    pub(super) fn tint(&mut self, block: usize, pixels: u64, material_id: u16, depth: f32) {
        for pixel in bits(pixels & !self.tinted[block]) {
            self.glass[block][pixel] = material_id;
            self.glass_depths[block][pixel] = depth;
        }
        self.tinted[block] |= pixels;
    }
}
