//! The compiler's tests of whole worlds, in one program that is linked once.

mod box_pairs;
mod box_visibility;
mod eye;
mod octree_bytes;
mod random_buildings;
mod suggest;
