//! The index by convex spaces: the engine's lists of members, for one box an avatar.

/// A set of spaces: a bit for each.
#[derive(Clone)]
pub struct SpaceSet(Vec<u64>);

impl SpaceSet {
    pub fn new(spaces: usize) -> Self {
        Self(vec![0; spaces.div_ceil(64)])
    }

    pub fn insert(&mut self, space: u32) {
        self.0[space as usize / 64] |= 1 << (space % 64);
    }

    fn remove(&mut self, space: u32) {
        self.0[space as usize / 64] &= !(1 << (space % 64));
    }

    pub fn unite(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(word, other)| *word |= other);
    }

    /// The spaces that are in both sets, ascending.
    pub fn shared<'a>(&'a self, other: &'a Self) -> impl Iterator<Item = u32> + 'a {
        (0..).zip(self.0.iter().zip(&other.0)).flat_map(|(place, (word, other))| {
            let mut left = word & other;
            std::iter::from_fn(move || {
                let bit = (left != 0).then(|| left.trailing_zeros())?;
                left &= left - 1;
                Some(place * 64 + bit)
            })
        })
    }
}

/// For each space, the volumes that overlap it.
#[derive(Clone)]
pub struct SpaceIndex {
    members: Vec<Vec<u32>>,
    pub occupied: SpaceSet,
}

impl SpaceIndex {
    pub fn new(spaces: usize) -> Self {
        Self { members: vec![Vec::new(); spaces], occupied: SpaceSet::new(spaces) }
    }

    pub fn insert(&mut self, volume: u32, spaces: &[u32]) {
        spaces.iter().for_each(|space| self.enter(volume, *space));
    }

    /// Moves a volume from some spaces to others. Both are ascending.
    pub fn replace(&mut self, volume: u32, old: &[u32], new: &[u32]) {
        for space in old.iter().filter(|space| new.binary_search(space).is_err()) {
            self.leave(volume, *space);
        }
        for space in new.iter().filter(|space| old.binary_search(space).is_err()) {
            self.enter(volume, *space);
        }
    }

    fn enter(&mut self, volume: u32, space: u32) {
        self.members[space as usize].push(volume);
        self.occupied.insert(space);
    }

    fn leave(&mut self, volume: u32, space: u32) {
        let members = &mut self.members[space as usize];
        let index = members.iter().position(|known| *known == volume);
        members.swap_remove(index.expect("the volume is in each space that it leaves"));
        if members.is_empty() {
            self.occupied.remove(space);
        }
    }

    /// The volumes in some of these spaces that pass a test, each once, ascending.
    pub fn among(&self, spaces: impl Iterator<Item = u32>, test: impl Fn(u32) -> bool) -> Vec<u32> {
        let mut found = Vec::new();
        for space in spaces {
            found.extend(self.members[space as usize].iter().filter(|volume| test(**volume)));
        }
        found.sort_unstable();
        found.dedup();
        found
    }
}
