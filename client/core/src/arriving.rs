//! A world that a client is in while it may still arrive in pieces.

use std::sync::Arc;

use glam::Vec3;
use sightline_world::{World, WorldHead, octree::Octree, plan::Plan};

use crate::fetching::{Outlook, PieceError, PieceFetcher};

/// A world that a client is in: a whole one, or one of which pieces are missing.
#[derive(Clone, Debug)]
pub struct ArrivingWorld {
    /// The world as it was entered, by which one knows it again.
    entered: Arc<World>,
    state: Arrived,
    /// The number of pieces that were taken in.
    taken: u64,
}

#[derive(Clone, Debug)]
enum Arrived {
    Whole(Arc<World>),
    Pieces(Box<PieceFetcher>),
}

impl ArrivingWorld {
    /// A world of which all is here.
    pub fn whole(world: Arc<World>) -> Self {
        Self { entered: world.clone(), state: Arrived::Whole(world), taken: 0 }
    }

    /// A world of which the head is here.
    pub fn from_head(head: WorldHead) -> Self {
        let entered = head.world.clone();
        let state = Arrived::Pieces(Box::new(PieceFetcher::new(head)));
        let mut world = Self { entered, state, taken: 0 };
        world.settle();
        world
    }

    /// Whether this is the world that was entered so.
    pub fn is(&self, world: &Arc<World>) -> bool {
        Arc::ptr_eq(&self.entered, world)
    }

    /// The world. While pieces are missing, it has no voxels and no mesh: see
    /// [`ArrivingWorld::octree`].
    pub fn world(&self) -> &Arc<World> {
        match &self.state {
            Arrived::Whole(world) => world,
            Arrived::Pieces(_) => &self.entered,
        }
    }

    /// The world with all its voxels; `None` while pieces are missing.
    pub fn complete(&self) -> Option<&Arc<World>> {
        match &self.state {
            Arrived::Whole(world) => Some(world),
            Arrived::Pieces(_) => None,
        }
    }

    /// The voxels that are here, and [stand-ins](sightline_world::octree::pieces::PartialOctree)
    /// for those that are not.
    pub fn octree(&self) -> &Octree {
        match &self.state {
            Arrived::Whole(world) => &world.octree,
            Arrived::Pieces(fetcher) => fetcher.octree().octree(),
        }
    }

    /// Sets what the voxels may take while pieces are missing, in bytes, as
    /// [`PieceFetcher::set_memory`] says.
    pub fn set_memory(&mut self, bytes: usize) {
        if let Arrived::Pieces(fetcher) = &mut self.state {
            fetcher.set_memory(bytes);
        }
    }

    /// What fetches the pieces that are missing; `None` when none is.
    pub fn fetcher(&self) -> Option<&PieceFetcher> {
        match &self.state {
            Arrived::Whole(_) => None,
            Arrived::Pieces(fetcher) => Some(fetcher),
        }
    }

    /// The plan of the storey of a body with its soles at this height, in metres, if it has come as
    /// a piece.
    pub fn plan_at(&self, soles: f32) -> Option<&Arc<Plan>> {
        self.fetcher()?.plan_at(soles)
    }

    /// The number of pieces that were taken in: a picture that was drawn before shows something else.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// The share of all bytes that is here, from 0 to 1.
    pub fn share(&self) -> f32 {
        self.fetcher().map_or(1.0, PieceFetcher::share)
    }

    /// Whether all voxels are here around a body with its eye there, so that it can move.
    pub fn is_open_at(&self, eye: Vec3) -> bool {
        self.fetcher().is_none_or(|fetcher| fetcher.is_open_at(eye))
    }

    /// The pieces to ask for now, as [`PieceFetcher::next`] says.
    pub fn next(&mut self, outlook: &Outlook<'_>, bytes_max: usize) -> Vec<usize> {
        match &mut self.state {
            Arrived::Whole(_) => Vec::new(),
            Arrived::Pieces(fetcher) => fetcher.next(outlook, bytes_max),
        }
    }

    /// Takes in that pieces do not come that were asked for. They are asked for again.
    pub fn forget(&mut self, numbers: &[usize]) {
        if let Arrived::Pieces(fetcher) = &mut self.state {
            fetcher.forget(numbers);
        }
    }

    /// Takes in that the server does not hand out pieces now, as [`PieceFetcher::refuse`] says.
    pub fn refuse(&mut self, numbers: &[usize]) {
        if let Arrived::Pieces(fetcher) = &mut self.state {
            fetcher.refuse(numbers);
        }
    }

    /// Takes in a piece. The last one makes the world a whole one.
    ///
    /// # Errors
    /// When the bytes are not the piece of this number.
    pub fn take(&mut self, number: usize, piece: Vec<u8>) -> Result<(), PieceError> {
        if let Arrived::Pieces(fetcher) = &mut self.state {
            fetcher.take(number, piece)?;
            self.taken += 1;
            self.settle();
        }
        Ok(())
    }

    /// Becomes a whole world once nothing is missing.
    fn settle(&mut self) {
        if let Arrived::Pieces(fetcher) = &mut self.state
            && fetcher.octree().is_complete()
        {
            let world = World { octree: fetcher.take_octree(), ..(*self.entered).clone() };
            self.state = Arrived::Whole(Arc::new(world));
        }
    }
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor;
    use sightline_world::{Viewpoints, WorldPieces};

    use super::*;

    #[test]
    fn a_world_whose_last_piece_has_come_is_a_whole_one() {
        let whole = voxel_floor::world(&[]);
        let octree = whole.octree.to_pieces();
        let seen = vec![(0..octree.branches.len() as u32).collect()];
        let cut = WorldPieces::new(&whole, octree, &Viewpoints::of(&whole.cells), &seen, &[]);
        let mut world = ArrivingWorld::from_head(WorldHead::read(&cut.head).unwrap());
        let entered = world.world().clone();
        let eye = voxel_floor::SPAWN.eye;
        assert!(world.complete().is_none() && !world.is_open_at(eye));
        let count = cut.pieces.len();
        for (number, piece) in cut.pieces.into_iter().enumerate() {
            assert!(world.complete().is_none(), "before piece {number}");
            assert!(world.share() < 1.0);
            world.take(number, piece).unwrap();
        }
        let complete = world.complete().expect("all is here");
        assert_eq!(complete.octree.materials, whole.octree.materials);
        assert!(complete.octree.leaf_at(eye.with_y(0.1)).is_some());
        assert!(world.is_open_at(eye) && world.is(&entered) && world.taken() == count as u64);
        assert_eq!(world.share(), 1.0);
    }
}
