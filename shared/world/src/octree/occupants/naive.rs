//! Method N of the paper: delete, then search from the root. What method B is compared with.

use super::{OccupantError, OccupantId, Occupants, tree::ROOT};
use crate::geometry::Aabb;

impl Occupants {
    /// Does what [`Occupants::move_to`] does, the naive way, for tests and benches: each primitive is
    /// deleted with the nodes that only it needs, and inserted again from the root. One after the
    /// other, as the paper advises, so that those yet to be moved keep their nodes in place.
    ///
    /// # Errors
    ///
    /// As [`Occupants::move_to`], and when the number of boxes changes.
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
