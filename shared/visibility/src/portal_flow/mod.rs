//! Portal flow: sight lines through sequences of gates. It is the cell-to-cell visibility of Teller
//! and Séquin 1991.
//!
//! A search starts in a space and goes from gate to gate. Each step keeps two boxes. The *source*
//! is the part of the original source from which the gate can be seen through the gates before it.
//! The *pass* is the part of the gate that can be seen from there. Every line that goes from the
//! source through the pass stays within the half-spaces that separate the two (`separators`).
//! These cut the next gate and, with the roles exchanged, the source. What is left of the two makes
//! the next step. If nothing is left, no line passes that sequence of gates. The steps form a
//! graph, in which each step knows the steps before it.
//!
//! For axial boxes the separating planes are the tangents of their projections along the three
//! axes, so that all arithmetic is on intervals. A gate that is not an axial rectangle adds the
//! planes through its edges.
//!
//! In open places very many sequences lead to one gate. A step is dropped if its source and pass
//! lie within those of an earlier step at the same gate. When a gate has `STEPS_AT_GATE_MAX` steps,
//! further ones are merged: the box around several stands for all of them. The box is larger, so
//! nothing is missed, and the work grows with the number of gates, not of sequences.
//!
//! A target that lies within the half-spaces of a step is finally tested by the exact test
//! (`exact`), with all boxes that a line has to meet on its way.

mod box_tree;
mod cell_block;
mod cell_search;
mod daabb;
mod directed_gate;
mod exact;
mod eye;
mod gather;
mod scratch;
mod search;
mod separators;
mod sequences;
mod sightlines;
mod step;
#[cfg(test)]
mod tests;

pub use cell_block::CellBlock;
pub use daabb::DAabb;
pub use scratch::FlowScratch;
pub use sightlines::{Query, Sightlines};
