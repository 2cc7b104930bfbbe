//! What a box of eyes sees of a patch.

/// What a box of eyes sees of a patch (Lim 1999, claim 1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PatchVisibility {
    /// No eye sees any of the patch.
    Invisible,
    /// Every eye sees all of the patch, and the patch hides only what is invisible anyway.
    Visible,
    /// Neither is certain.
    Remaining,
}
