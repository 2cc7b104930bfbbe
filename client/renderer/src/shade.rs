//! Colouring a band: materials become colours, with air, sky and glass.

use super::{
    band::Band,
    colour::{hazed, sky_line, through_glass},
    mask::{BLOCK, bits, lines},
    panes::BandPanes,
    view::BandView,
};

/// The rows of a frame that a band is written to.
pub(super) struct FrameRows<'a> {
    pub(super) colour: &'a mut [u32],
    pub(super) depth: &'a mut [f32],
    pub(super) material_ids: &'a mut [u16],
    /// An upper bound of the depths of each block.
    pub(super) farthest: &'a mut [f32],
    pub(super) panes: &'a mut BandPanes,
}

/// Colours what a band shows, with the sky where nothing is written, and glass over what is behind
/// it. `colours` has a colour for every material.
#[inline(always)]
pub(super) fn band(band: &Band, view: &BandView, colours: &[u32], rows: &mut FrameRows) {
    let width = band.width;
    assert_eq!(rows.colour.len(), width * band.height, "the frame's rows are the band's");
    rows.panes.clear(width.div_ceil(BLOCK), band.height.div_ceil(BLOCK));
    for row in 0..band.height.div_ceil(BLOCK) {
        for column in 0..width.div_ceil(BLOCK) {
            let block = row * band.mask.across() + column;
            // The air is equally thick all over a block.
            let ray = view.ray(column * BLOCK + BLOCK / 2, row * BLOCK + BLOCK / 2);
            let length = ray.length();
            let material_ids = band.material_ids[block].as_chunks::<BLOCK>().0;
            let depths = band.depths[block].as_chunks::<BLOCK>().0;
            let count = BLOCK.min(width - column * BLOCK);
            let mut farthest = [0.0f32; BLOCK];
            for y in 0..BLOCK.min(band.height - row * BLOCK) {
                let at = (row * BLOCK + y) * width + column * BLOCK;
                let mut pixels =
                    material_ids[y].map(|material_id| colours[usize::from(material_id)]);
                for (pixel, depth) in pixels.iter_mut().zip(depths[y]) {
                    *pixel = hazed(*pixel, length * depth);
                }
                put(&mut rows.colour[at..at + count], &pixels);
                put(&mut rows.depth[at..at + count], &depths[y]);
                put(&mut rows.material_ids[at..at + count], &material_ids[y]);
                for (farthest, depth) in farthest.iter_mut().zip(depths[y]) {
                    *farthest = if depth > *farthest { depth } else { *farthest };
                }
            }
            rows.farthest[row * width.div_ceil(BLOCK) + column] =
                farthest[..count].iter().fold(0.0, |most, depth| depth.max(most));
            finish(band, view, colours, rows, [column, row]);
        }
    }
}

/// Writes as many pixels of a row of a block as fit.
#[inline(always)]
fn put<T: Copy>(to: &mut [T], from: &[T; BLOCK]) {
    match <&mut [T; BLOCK]>::try_from(&mut *to) {
        Ok(to) => *to = *from,
        Err(_) => to.copy_from_slice(&from[..to.len()]),
    }
}

/// Adds the sky and the glass of a block.
#[inline(always)]
fn finish(band: &Band, view: &BandView, colours: &[u32], rows: &mut FrameRows, at: [usize; 2]) {
    let block = at[1] * band.mask.across() + at[0];
    let place = |pixel: usize| [at[0] * BLOCK + pixel % BLOCK, at[1] * BLOCK + pixel / BLOCK];
    let open = !band.mask.word(block);
    if open != 0 {
        rows.farthest[at[1] * band.width.div_ceil(BLOCK) + at[0]] = f32::INFINITY;
    }
    for line in bits(lines(open)) {
        let [x, y] = place(line * BLOCK);
        let colours = sky_line(view.ray(x, y), view.ray_step[0]);
        for i in bits(open >> (line * BLOCK) & 0xff) {
            rows.colour[y * band.width + x + i] = colours[i];
            rows.depth[y * band.width + x + i] = f32::INFINITY;
        }
    }
    let tinted = band.tinted[block];
    if tinted == 0 {
        return;
    }
    let glass = |pixel: usize| colours[usize::from(band.glass[block][pixel])];
    for pixel in bits(tinted) {
        let [x, y] = place(pixel);
        let colour = &mut rows.colour[y * band.width + x];
        *colour = through_glass(*colour, glass(pixel));
    }
    rows.panes.add(block, tinted, &band.glass_depths[block], glass);
}
