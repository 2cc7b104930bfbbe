//! The pairs of a viewer, and the certificates that say when each must be looked at again.

use sightline_world::motion::AvatarId;

use crate::{
    generation::Generation,
    pair::{Pair, RegionMargin},
    slot::{Member, Slot},
};

/// Until when nothing need be done about a pair. A tick reads the certificates of all pairs, and
/// the pairs of those that have ended. So they are small, and side by side.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Certificate {
    /// The other avatar.
    pub(crate) slot: Slot,
    /// The certificate ends at this tick at the latest.
    pub(crate) until: u32,
    /// Something may have to be told at this tick.
    pub(crate) tell: u32,
    pub(crate) grounds: Grounds,
    /// For [`Grounds::Hidden`]: the version of the viewer's eye region.
    pub(crate) eyes: Generation,
    /// For [`Grounds::Hidden`]: the version of the avatar's body region.
    pub(crate) bodies: Generation,
}

/// What a certificate rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Grounds {
    /// All lines are blocked as long as the cached regions with this margin last.
    Hidden(RegionMargin),
    /// All lines are blocked, but it is not known for how long.
    HiddenNow,
    /// The two may see each other. What the avatar's client reports may have to be told.
    MaySee,
    /// As [`Grounds::MaySee`], for as long as both are in one convex space.
    Together,
}

impl Grounds {
    /// Whether the two may see each other.
    pub(crate) fn may_see(self) -> bool {
        matches!(self, Self::MaySee | Self::Together)
    }
}

impl Certificate {
    /// A certificate that ends at once.
    fn ended(slot: Slot) -> Self {
        let (eyes, bodies) = Default::default();
        Self { slot, until: 0, tell: 0, grounds: Grounds::HiddenNow, eyes, bodies }
    }
}

/// The pairs of a viewer, by the ids of the other avatars.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pairs {
    all: Vec<Pair>,
    /// The certificate of each pair.
    certificates: Vec<Certificate>,
}

impl Pairs {
    pub(crate) fn len(&self) -> usize {
        self.all.len()
    }

    pub(crate) fn iter(&self) -> std::slice::Iter<'_, Pair> {
        self.all.iter()
    }

    pub(crate) fn get(&self, id: AvatarId) -> Option<&Pair> {
        self.position(id).ok().map(|at| &self.all[at])
    }

    /// The certificates of all pairs.
    pub(crate) fn certificates_mut(&mut self) -> &mut [Certificate] {
        &mut self.certificates
    }

    /// A pair, by position.
    pub(crate) fn at(&self, at: usize) -> &Pair {
        &self.all[at]
    }

    /// A pair and its certificate, by position.
    pub(crate) fn at_mut(&mut self, at: usize) -> (&mut Pair, &mut Certificate) {
        (&mut self.all[at], &mut self.certificates[at])
    }

    /// Whether something must be done about a pair at a tick, by position.
    pub(crate) fn is_due(&self, at: usize, tick: u32) -> bool {
        let Certificate { until, tell, .. } = self.certificates[at];
        until.min(tell) <= tick
    }

    /// Whether sight tests must look at a pair at a tick, by position. Two in one space see each
    /// other, whatever there is to be told; a look at each such pair is much of the cost of a crowd.
    pub(crate) fn may_need_test(&self, at: usize, tick: u32) -> bool {
        let Certificate { until, tell, grounds, .. } = self.certificates[at];
        until <= tick || tell <= tick && grounds != Grounds::Together
    }

    /// Makes a pair, unless there is one.
    pub(crate) fn start(&mut self, member: Member) {
        match self.position(member.id) {
            Ok(at) => {
                self.all[at].is_candidate = true;
                self.certificates[at].until = 0;
            }
            Err(at) => {
                self.all.insert(at, Pair::new(member));
                self.certificates.insert(at, Certificate::ended(member.slot));
            }
        }
    }

    /// Ends a pair. A pair that the client still holds stays until the client is told.
    pub(crate) fn end(&mut self, id: AvatarId) {
        if let Ok(at) = self.position(id) {
            self.all[at].is_candidate = false;
            self.certificates[at].until = 0;
            if !self.all[at].is_held {
                self.take(at);
            }
        }
    }

    /// Removes a pair at once.
    pub(crate) fn remove(&mut self, id: AvatarId) -> Option<Pair> {
        self.position(id).ok().map(|at| self.take(at))
    }

    /// Removes the pairs that do not concern the viewer any more.
    pub(crate) fn remove_ended(&mut self) {
        let mut is_candidate = self.all.iter().map(|pair| pair.is_candidate);
        self.certificates.retain(|_| is_candidate.next().unwrap_or(false));
        self.all.retain(|pair| pair.is_candidate);
    }

    /// Makes and ends pairs, so that the viewer is paired with just these avatars, which are by id.
    /// Pairs that the client still holds stay until the client is told.
    pub(crate) fn match_to(&mut self, found: Vec<Member>) {
        debug_assert!(found.is_sorted(), "pairs are by id");
        let old = std::mem::take(self);
        self.all.reserve(found.len());
        self.certificates.reserve(found.len());
        let mut found = found.into_iter().peekable();
        for (pair, certificate) in old.all.into_iter().zip(old.certificates) {
            while let Some(new) = found.next_if(|member| member.id < pair.id) {
                self.push(Pair::new(new), Certificate::ended(new.slot));
            }
            let is_candidate = found.next_if(|member| member.id == pair.id).is_some();
            if is_candidate || pair.is_held {
                let until = if is_candidate == pair.is_candidate { certificate.until } else { 0 };
                self.push(Pair { is_candidate, ..pair }, Certificate { until, ..certificate });
            }
        }
        found.for_each(|new| self.push(Pair::new(new), Certificate::ended(new.slot)));
    }

    /// Forgets what was found of a pair.
    pub(crate) fn forget(&mut self, id: AvatarId) {
        if let Ok(at) = self.position(id) {
            self.all[at].forget();
            self.certificates[at].until = 0;
        }
    }

    /// Forgets what was found of all pairs.
    pub(crate) fn forget_all(&mut self) {
        self.all.iter_mut().for_each(Pair::forget);
        self.certificates.iter_mut().for_each(|certificate| certificate.until = 0);
    }

    /// Takes in that the viewer's client has been told of nobody. Returns whom it had been told of.
    pub(crate) fn release(&mut self) -> Vec<Slot> {
        self.forget_all();
        let held = self
            .all
            .iter_mut()
            .filter_map(|pair| std::mem::take(&mut pair.is_held).then_some(pair.slot));
        held.collect()
    }

    fn push(&mut self, pair: Pair, certificate: Certificate) {
        debug_assert_eq!(pair.slot, certificate.slot, "a certificate is of its pair");
        self.all.push(pair);
        self.certificates.push(certificate);
    }

    fn take(&mut self, at: usize) -> Pair {
        self.certificates.remove(at);
        self.all.remove(at)
    }

    fn position(&self, id: AvatarId) -> Result<usize, usize> {
        self.all.binary_search_by_key(&id, |pair| pair.id)
    }
}
