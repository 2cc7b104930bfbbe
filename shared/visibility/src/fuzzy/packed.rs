//! What was found for a box of eyes, as few bytes.

use super::PatchVisibility;

/// The three classes.
const CLASSES: [PatchVisibility; 3] =
    [PatchVisibility::Invisible, PatchVisibility::Visible, PatchVisibility::Remaining];

/// The classes of all patches for one box of eyes, packed: two of the three lists of patches, the
/// smallest, by the differences from one patch to the next; or, when that is less, which patches are
/// in another class than they were for a neighbouring box.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PackedVisibility {
    count: u32,
    bytes: Vec<u8>,
    /// It says what is different from a neighbour.
    is_change: bool,
}

/// Why no classes can be read from packed lists.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UnpackError {
    /// They were packed as changes to a neighbour's, which is not the one given.
    #[error("these lists are changes to those of a neighbour, which must be given with them")]
    Neighbour,
    /// The bytes are no lists of so many patches.
    #[error("these lists are damaged")]
    Damaged,
}

impl PackedVisibility {
    /// Packs classes, if it pays as changes to those of a neighbouring box.
    pub fn new(classes: &[PatchVisibility], neighbour: Option<&[PatchVisibility]>) -> Self {
        let count = u32::try_from(classes.len()).unwrap_or(u32::MAX);
        let whole = Self { count, bytes: whole(classes), is_change: false };
        let Some(before) = neighbour.filter(|before| before.len() == classes.len()) else {
            return whole;
        };
        let change = Self { count, bytes: change(classes, before), is_change: true };
        if change.bytes.len() < whole.bytes.len() { change } else { whole }
    }

    /// How many bytes they take.
    pub fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Whether no patches are in them.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Whether the neighbour's classes are needed to read them.
    pub fn is_change(&self) -> bool {
        self.is_change
    }

    /// The classes of all patches.
    ///
    /// # Errors
    /// When they are changes to a neighbour's, and that is not given; or damaged.
    pub fn classes(
        &self,
        neighbour: Option<&[PatchVisibility]>,
    ) -> Result<Vec<PatchVisibility>, UnpackError> {
        let mut bytes = self.bytes.as_slice();
        let mut classes;
        if self.is_change {
            let before = neighbour.filter(|before| before.len() == self.count as usize);
            classes = before.ok_or(UnpackError::Neighbour)?.to_vec();
            for class in CLASSES {
                read(&mut bytes, &mut classes, class)?;
            }
        } else {
            let (&left_out, rest) = bytes.split_first().ok_or(UnpackError::Damaged)?;
            bytes = rest;
            let most = *CLASSES.get(usize::from(left_out)).ok_or(UnpackError::Damaged)?;
            classes = vec![most; self.count as usize];
            for class in CLASSES.into_iter().filter(|class| *class != most) {
                read(&mut bytes, &mut classes, class)?;
            }
        }
        if bytes.is_empty() { Ok(classes) } else { Err(UnpackError::Damaged) }
    }
}

/// The class that is left out, which has most patches, and the lists of the others.
fn whole(classes: &[PatchVisibility]) -> Vec<u8> {
    let count = |class: PatchVisibility| classes.iter().filter(|of| **of == class).count();
    let most =
        CLASSES.into_iter().max_by_key(|class| count(*class)).unwrap_or(PatchVisibility::Remaining);
    let mut bytes: Vec<u8> =
        (0..).zip(CLASSES).filter(|(_, class)| *class == most).map(|(place, _)| place).collect();
    for class in CLASSES.into_iter().filter(|class| *class != most) {
        write(&mut bytes, count(class), classes.iter().map(|of| *of == class));
    }
    bytes
}

/// For each class the patches that have come into it.
fn change(classes: &[PatchVisibility], before: &[PatchVisibility]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for class in CLASSES {
        let is_new = classes.iter().zip(before).map(|(now, then)| *now == class && *then != class);
        write(&mut bytes, is_new.clone().filter(|is_new| *is_new).count(), is_new);
    }
    bytes
}

/// Writes how many there are, and then how far it is from each to the next.
fn write(bytes: &mut Vec<u8>, count: usize, members: impl Iterator<Item = bool>) {
    number(bytes, count);
    let mut next = 0;
    for (place, _) in members.enumerate().filter(|(_, is_member)| *is_member) {
        number(bytes, place - next);
        next = place + 1;
    }
}

fn read(
    bytes: &mut &[u8],
    classes: &mut [PatchVisibility],
    class: PatchVisibility,
) -> Result<(), UnpackError> {
    let mut next = 0usize;
    for _ in 0..read_number(bytes)? {
        let place = next.checked_add(read_number(bytes)?).ok_or(UnpackError::Damaged)?;
        *classes.get_mut(place).ok_or(UnpackError::Damaged)? = class;
        next = place + 1;
    }
    Ok(())
}

/// Seven bits to a byte, the lowest first.
fn number(bytes: &mut Vec<u8>, mut value: usize) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

fn read_number(bytes: &mut &[u8]) -> Result<usize, UnpackError> {
    let mut value = 0;
    for shift in (0..32).step_by(7) {
        let (&byte, rest) = bytes.split_first().ok_or(UnpackError::Damaged)?;
        *bytes = rest;
        value |= usize::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err(UnpackError::Damaged)
}
