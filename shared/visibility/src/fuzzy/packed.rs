//! The visibility of all patches, stored in few bytes (Lim 1999, claims 19 to 28).

use super::visibility::PatchVisibility;

/// The three kinds of visibility, each of which has a list.
const CLASSES: [PatchVisibility; 3] =
    [PatchVisibility::Invisible, PatchVisibility::Visible, PatchVisibility::Remaining];

/// The visibility of all patches for one box of eyes, packed. There are two forms. One has the
/// smaller two of the three lists of patches, as differences from one patch to the next. The other
/// has the changes to the lists of a neighbouring box. The shorter form is stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PackedVisibility {
    count: u32,
    bytes: Vec<u8>,
    /// Whether the bytes are changes to a neighbour's lists.
    is_change: bool,
}

/// Why packed lists cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UnpackError {
    /// The lists are changes to a neighbour's, and none or another one was given.
    #[error("the lists are changes to a neighbour's lists, which must be given with them")]
    Neighbour,
    /// The bytes are not lists of this many patches.
    #[error("the lists are damaged")]
    Damaged,
}

impl PackedVisibility {
    /// Packs the visibility of all patches. If it is shorter, only the changes to a neighbouring
    /// box's are stored.
    pub fn new(classes: &[PatchVisibility], neighbour: Option<&[PatchVisibility]>) -> Self {
        let count = u32::try_from(classes.len()).unwrap_or(u32::MAX);
        let whole = Self { count, bytes: whole(classes), is_change: false };
        let Some(before) = neighbour.filter(|before| before.len() == classes.len()) else {
            return whole;
        };
        let change = Self { count, bytes: change(classes, before), is_change: true };
        if change.bytes.len() < whole.bytes.len() { change } else { whole }
    }

    /// The number of bytes.
    pub fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Whether there are no patches.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Whether the neighbour's lists are needed to read these.
    pub fn is_change(&self) -> bool {
        self.is_change
    }

    /// The visibility of all patches, in order.
    ///
    /// # Errors
    /// The lists are changes to a neighbour's and it is not given, or they are damaged.
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

/// The number of the longest list, which is left out, and then the other two lists.
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

/// For each list the patches that were added to it.
fn change(classes: &[PatchVisibility], before: &[PatchVisibility]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for class in CLASSES {
        let is_new = classes.iter().zip(before).map(|(now, then)| *now == class && *then != class);
        write(&mut bytes, is_new.clone().filter(|is_new| *is_new).count(), is_new);
    }
    bytes
}

/// Writes the length of a list, and then the differences from each member to the next.
fn write(bytes: &mut Vec<u8>, count: usize, members: impl Iterator<Item = bool>) {
    debug_assert!(u32::try_from(count).is_ok(), "lists hold less than 2³² patches");
    write_number(bytes, count);
    let mut next = 0;
    for (place, _) in members.enumerate().filter(|(_, is_member)| *is_member) {
        write_number(bytes, place - next);
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

/// Writes a number with seven bits in each byte, the lowest first.
fn write_number(bytes: &mut Vec<u8>, mut value: usize) {
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
