//! Glass in a frame, for what is drawn into the frame later and lies behind it.

use super::{
    band::BAND_ROWS,
    colour,
    mask::{BLOCK, bits},
};

/// The panes that pixels of a picture show first.
#[derive(Clone, Debug, PartialEq, Default)]
pub(super) struct Panes {
    pub(super) bands: Vec<BandPanes>,
    /// Whether there are twice as many rows and columns of them as the frame has.
    pub(super) finer: bool,
}

impl Panes {
    /// The colour of something at a depth, with the glass over it.
    pub(super) fn over(&self, [x, y]: [usize; 2], depth: f32, colour: u32) -> u32 {
        let [x, y] = if self.finer { [2 * x, 2 * y] } else { [x, y] };
        let pane = self.bands.get(y / BAND_ROWS).and_then(|band| band.at(x, y % BAND_ROWS));
        match pane.filter(|&(pane_depth, _)| pane_depth < depth) {
            Some((_, glass)) => colour::through_glass(colour, glass),
            None => colour,
        }
    }
}

/// Those of a band.
#[derive(Clone, Debug, PartialEq, Default)]
pub(super) struct BandPanes {
    across: usize,
    /// For each block of the band one more than its place in `blocks`; zero when it has no glass.
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
    /// Begins a band of so many blocks.
    pub(super) fn clear(&mut self, across: usize, down: usize) {
        self.across = across;
        self.places.clear();
        self.places.resize(across * down, 0);
        self.blocks.clear();
    }

    /// Adds the glass of a block: which pixels have some, how far away and in which colour.
    pub(super) fn add(
        &mut self,
        block: usize,
        tinted: u64,
        depths: &[f32; BLOCK * BLOCK],
        colour: impl Fn(usize) -> u32,
    ) {
        let mut colours = [0; BLOCK * BLOCK];
        bits(tinted).for_each(|pixel| colours[pixel] = colour(pixel));
        self.blocks.push(Block { tinted, depths: *depths, colours });
        self.places[block] = self.blocks.len() as u32;
    }

    /// The depth and the colour of a pixel's pane.
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
