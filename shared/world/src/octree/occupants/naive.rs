//! Method N of Sudarsky and Gotsman 1996: delete, then insert from the root. It is the reference
//! for method B.

use super::{OccupantError, OccupantId, Occupants, tree::ROOT};
use crate::geometry::Aabb;

impl Occupants {
    /// Moves an object like [`Occupants::move_to`], but naively, for tests and benchmarks. Each
    /// primitive is deleted with the nodes that only it needs, and inserted again from the root.
    /// They are moved one after another, as the paper advises, so that the others keep their nodes.
    ///
    /// # Errors
    ///
    /// The errors of [`Occupants::move_to`]; also when the number of boxes changes.
    #[doc(hidden)]
    pub fn move_naively(
        &mut self,
        object: OccupantId,
        primitives: &[Aabb],
    ) -> Result<(), OccupantError> {
        let held = self.held(object)?;
        self.check(primitives, held.len())?;
        if held.len() != primitives.len() {
            return Err(OccupantError::NoPrimitive);
        }
        for (index, bounds) in primitives.iter().enumerate() {
            let primitive = self.objects[object.0 as usize][index];
            self.tree.leave(primitive, None, &mut self.scratch.left);
            self.tidy();
            let span = self.tree.grid.span(bounds);
            let of = &mut self.tree.primitives[primitive as usize];
            (of.bounds, of.span) = (*bounds, span);
            self.tree.insert(ROOT, primitive);
        }
        Ok(())
    }
}
