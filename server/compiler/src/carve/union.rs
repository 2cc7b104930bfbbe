//! Connected components, by union and find.

/// Which things are connected (Tarjan 1975).
pub(super) struct Union {
    parent: Vec<u32>,
}

impl Union {
    /// This many things, none connected.
    pub(super) fn new(count: usize) -> Self {
        Self { parent: (0..count as u32).collect() }
    }

    /// The root of the component of a thing.
    pub(super) fn root(&mut self, mut of: u32) -> u32 {
        while self.parent[of as usize] != of {
            let above = self.parent[self.parent[of as usize] as usize];
            self.parent[of as usize] = above;
            of = above;
        }
        of
    }

    /// Connects two things. The root is the least member, so that the order of calls does not
    /// matter.
    pub(super) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    /// The components of some things, in order of their first member.
    pub(super) fn groups(mut self, members: impl Iterator<Item = u32>) -> Vec<Vec<u32>> {
        let mut index_of = std::collections::HashMap::new();
        let mut groups: Vec<Vec<u32>> = Vec::new();
        for member in members {
            let index = *index_of.entry(self.root(member)).or_insert_with(|| {
                groups.push(Vec::new());
                groups.len() - 1
            });
            groups[index].push(member);
        }
        groups
    }
}
