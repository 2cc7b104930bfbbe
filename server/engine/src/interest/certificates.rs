//! Certificates: which pairs a tick must look at.
//!
//! A pair is looked at when its certificate ends, and not before. The certificate of a hidden pair
//! ends with the cached regions for which it was proved. An open pair is looked at again after an
//! interval, and when there is news of the avatar. A tick compares the certificates of all pairs
//! with what they rest on. That is a few nanoseconds for each, less than a queue of deadlines would
//! cost.

use sightline_world::motion::AvatarId;

use super::snapshot::{LiveAvatar, Snapshot};
use crate::{
    generation::Generation,
    pair::{EyeBoxes, Pair, RegionMargin, RegionVersions, SightResult},
    pairs::{Certificate, Grounds, Pairs},
    population::{Avatar, Population},
    regions::RegionKind,
    slot::Slot,
    tick_context::TickContext,
};

/// The most pairs that are looked at in each tick although nothing has changed. With more pairs,
/// each open one waits for more ticks.
const LOOKS: usize = 1_500;
/// The most ticks before an open pair is looked at again.
const INTERVAL_MAX: usize = 8;

/// What certificates rest on, by slot, side by side.
pub(crate) struct CertificateInputs {
    tick: u32,
    /// How many ticks an open pair waits for the next look.
    pub(super) interval: u32,
    /// For how many ticks pairs may have to wait for a sight test.
    queue: u32,
    /// Whether rooms rule anything out, so that seals may change when a viewer moves.
    has_rules: bool,
    /// How many ticks too late certificates end, by an injected fault.
    late: u32,
    avatars: Vec<AvatarInputs>,
    /// For each slot, the versions of all its cached regions, by kind.
    versions: Vec<[Generation; RegionMargin::COUNT]>,
    kinds: usize,
}

#[derive(Clone, Copy, Default)]
struct AvatarInputs {
    /// The space that the avatar is in.
    space: Option<u32>,
    /// Whether there is a new pose of the avatar.
    has_news: bool,
}

impl CertificateInputs {
    /// The facts of a tick.
    pub(crate) fn new(context: TickContext<'_>, snapshot: &Snapshot<'_>) -> Self {
        let Snapshot { live, pairs } = snapshot;
        let pairs: usize = pairs.iter().map(|pairs| pairs.len()).sum();
        let kinds = live.all().first().map_or(0, |avatar| avatar.regions.kinds());
        let mut inputs = Self {
            tick: context.tick,
            interval: pairs.div_ceil(LOOKS).clamp(1, INTERVAL_MAX) as u32,
            queue: 1,
            has_rules: context.building.rooms.can_rule_out(),
            late: context.config.faults.certificates_late,
            avatars: vec![AvatarInputs::default(); live.slots()],
            versions: vec![Default::default(); live.slots() * kinds],
            kinds,
        };
        for LiveAvatar { member, regions, has_news, .. } in live.all() {
            let slot = member.slot.0 as usize;
            inputs.avatars[slot] = AvatarInputs { space: regions.space(), has_news: *has_news };
            let versions = &mut inputs.versions[slot * kinds..][..kinds];
            versions.iter_mut().zip(regions.versions()).for_each(|(to, from)| *to = from);
        }
        inputs
    }

    /// Takes in for how many ticks pairs may have to wait for a sight test, at least one.
    pub(crate) fn queue_for(&mut self, ticks: u32) {
        debug_assert!(ticks > 0, "a queue moves on");
        self.queue = ticks;
    }

    /// Ends the certificates of a viewer that do not hold any more.
    pub(super) fn end(&self, viewer: &LiveAvatar<'_>, pairs: &mut Pairs) {
        let AvatarInputs { space, has_news } = self.avatars[viewer.member.slot.0 as usize];
        let shown = viewer.regions.shown();
        let has_other_seals = has_news && self.has_rules;
        for certificate in pairs.certificates_mut() {
            let Certificate { slot, grounds, .. } = *certificate;
            let other = || self.avatars[slot.0 as usize];
            let holds = match grounds {
                Grounds::Hidden(margin) => {
                    let eyes = self.version(viewer.member.slot, RegionKind::EYES, margin);
                    certificate.eyes == eyes
                        && certificate.bodies == self.version(slot, shown, margin)
                }
                Grounds::HiddenNow | Grounds::MaySee => true,
                Grounds::Together => space.is_some() && space == other().space,
            };
            if !holds {
                certificate.until = certificate.until.min(self.tick + self.late);
            }
            if has_other_seals || grounds.may_see() && other().has_news {
                certificate.tell = self.tick;
            }
        }
    }

    fn version(&self, slot: Slot, kind: RegionKind, margin: RegionMargin) -> Generation {
        self.versions[slot.0 as usize * self.kinds + kind.index()][margin as usize]
    }

    /// The next certificate of a pair, and when something may have to be told, if there is no news
    /// before.
    pub(super) fn renewed(&self, last: &Certificate, pair: &Pair, tell: u32) -> Certificate {
        if last.until > self.tick && last.grounds.may_see() != pair.sight.is_hidden() {
            return Certificate { tell, ..*last };
        }
        let later = self.tick + self.interval;
        let (mut eyes, mut bodies) = Default::default();
        let (grounds, until) = match pair.sight {
            SightResult::Hidden(regions) => {
                (eyes, bodies) = (regions.eyes, regions.bodies);
                (Grounds::Hidden(regions.margin), u32::MAX)
            }
            SightResult::HiddenIn(_) => (Grounds::HiddenNow, 0),
            SightResult::Together => (Grounds::Together, u32::MAX),
            SightResult::Free(_) => (Grounds::MaySee, later),
            SightResult::Undecided { again, .. } if again > self.tick => {
                (Grounds::MaySee, again.min(later))
            }
            // The budget did not suffice for all. Those that wait come back one after the other.
            SightResult::Undecided { .. } | SightResult::Unknown => {
                (Grounds::MaySee, self.tick + 1 + pair.slot.0 % self.queue)
            }
        };
        Certificate {
            slot: pair.slot,
            until: until.max(self.tick + 1),
            tell,
            grounds,
            eyes,
            bodies,
        }
    }
}

/// A viewer and an avatar that count as hidden from each other although what was found of them does
/// not hold any more. A naive look at all pairs, for tests.
pub(crate) fn find_stale(population: &Population) -> Option<[AvatarId; 2]> {
    let live = || population.live().map(|slot| population.at(slot));
    live().find_map(|viewer| {
        let stale = viewer.pairs.iter().find(|pair| is_stale(viewer, population, pair));
        stale.map(|pair| [viewer.id, pair.id])
    })
}

fn is_stale(viewer: &Avatar, population: &Population, pair: &Pair) -> bool {
    let (avatar, bodies) = (population.at(pair.slot), viewer.regions.shown());
    match pair.sight {
        SightResult::Hidden(then) => {
            let eyes = viewer.regions.version(RegionKind::EYES, then.margin);
            let bodies = avatar.regions.version(bodies, then.margin);
            then != RegionVersions { margin: then.margin, eyes, bodies }
        }
        SightResult::HiddenIn(then) => {
            let viewer = viewer.regions.eyes(RegionKind::EYES);
            !then.contain(&EyeBoxes { viewer, avatar: avatar.regions.eyes(bodies) })
        }
        _ => false,
    }
}
