//! The glass of a frame, seen in front of what is drawn into the frame later.

use super::{
    band::BAND_ROWS,
    colour,
    mask::{BLOCK, bits},
};

/// The nearest pane of glass of each pixel of a picture.
#[derive(Clone, Debug, PartialEq, Default)]
pub(super) struct Panes {
    pub(super) bands: Vec<BandPanes>,
    /// Whether the panes have twice as many rows and columns as the frame.
    pub(super) finer: bool,
}

impl Panes {
    /// The colour that a pixel shows of something at a depth: seen through the pane, if that is
    /// nearer.
    pub(super) fn over(&self, [x, y]: [usize; 2], depth: f32, colour: u32) -> u32 {
        match self.at([x, y]).filter(|&(pane_depth, _)| pane_depth < depth) {
            Some((_, glass)) => colour::through_glass(colour, glass),
            None => colour,
        }
    }

    /// The depth of the pane that a pixel shows, if it shows one.
    pub(super) fn depth_at(&self, pixel: [usize; 2]) -> Option<f32> {
        self.at(pixel).map(|(depth, _)| depth)
    }

    /// The depth and the colour of a pixel's pane, if it has one.
    fn at(&self, [x, y]: [usize; 2]) -> Option<(f32, u32)> {
        let [x, y] = if self.finer { [2 * x, 2 * y] } else { [x, y] };
        self.bands.get(y / BAND_ROWS).and_then(|band| band.at(x, y % BAND_ROWS))
    }
}

/// The panes of a band.
#[derive(Clone, Debug, PartialEq, Default)]
pub(super) struct BandPanes {
    /// Blocks in a row.
    across: usize,
    /// The index in `blocks` plus one for each block of the band; zero for a block without glass.
    places: Vec<u32>,
    blocks: Vec<Block>,
}

#[derive(Clone, Debug, PartialEq)]
struct Block {
    tinted: u64,
    depths: [f32; BLOCK * BLOCK],
    colours: [u32; BLOCK * BLOCK],
}

impl BandPanes {
    /// Begins a band of this many blocks, without glass.
    pub(super) fn clear(&mut self, across: usize, down: usize) {
        self.across = across;
        self.places.clear();
        self.places.resize(across * down, 0);
        self.blocks.clear();
    }

    /// Adds the glass of a block: a mask of the pixels that have some, its depth and its colour.
    pub(super) fn add(
        &mut self,
        block: usize,
        tinted: u64,
        depths: &[f32; BLOCK * BLOCK],
        colour: impl Fn(usize) -> u32,
    ) {
        debug_assert_eq!(self.places[block], 0, "block {block} has its glass already");
        let mut colours = [0; BLOCK * BLOCK];
        bits(tinted).for_each(|pixel| colours[pixel] = colour(pixel));
        self.blocks.push(Block { tinted, depths: *depths, colours });
        self.places[block] = self.blocks.len() as u32;
    }

    /// The depth and the colour of a pixel's pane, if it has one.
    fn at(&self, x: usize, y: usize) -> Option<(f32, u32)> {
        if self.blocks.is_empty() {
            return None;
        }
        let place = *self.places.get(y / BLOCK * self.across + x / BLOCK)? as usize;
        let block = self.blocks.get(place.checked_sub(1)?)?;
        let pixel = y % BLOCK * BLOCK + x % BLOCK;
        (block.tinted >> pixel & 1 == 1).then(|| (block.depths[pixel], block.colours[pixel]))
    }
}
