//! What was ruled about somebody, and when: what servers can agree on in any order.

use std::time::SystemTime;

use serde::{Deserialize, Serialize};
use sightline_protocol::text::ChatLine;

use super::{changes::Act, role::Role, standing::Standing};

/// The date of what older versions noted without one. Whatever was ruled since then is later.
pub const UNDATED: u64 = 1;

/// The last date of a ruling, in milliseconds since 1970: the end of the year 2199. A clock that
/// is wrong shows an earlier one.
#[cfg(feature = "bus")]
const DATE_MAX: u64 = 7_258_118_399_999;

/// What was ruled about a subject. Each part has a date of its own, so that what two moderators
/// do at once both counts.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Ruling {
    /// What the subject may do.
    #[serde(skip_serializing_if = "Dated::is_open")]
    pub role: Dated<Role>,
    /// Whether nobody hears what it says.
    #[serde(skip_serializing_if = "Dated::is_open")]
    pub muted: Dated<bool>,
    /// Whether it is let in where not everybody is.
    #[serde(skip_serializing_if = "Dated::is_open")]
    pub allowed: Dated<bool>,
    /// Why it is kept out, if it is.
    #[serde(skip_serializing_if = "Dated::is_open")]
    pub banned: Dated<Option<String>>,
}

/// A part of a ruling.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Dated<T> {
    /// What was ruled.
    pub is: T,
    /// When, in milliseconds since 1970; zero if nothing was.
    pub at: u64,
}

impl Ruling {
    /// What a server without dates knew of a visitor.
    pub fn undated(standing: Standing) -> Self {
        let Standing { role, is_muted, is_allowed } = standing;
        Self {
            role: Dated::undated(role),
            muted: Dated::undated(is_muted),
            allowed: Dated::undated(is_allowed),
            banned: Dated::default(),
        }
    }

    /// How the server stands to the subject.
    pub fn standing(&self) -> Standing {
        let Self { role, muted, allowed, .. } = self;
        Standing { role: role.is, is_muted: muted.is, is_allowed: allowed.is }
    }

    /// Whether nothing was ruled.
    pub fn is_open(&self) -> bool {
        *self == Self::default()
    }

    /// Takes in what is ruled now, in milliseconds since 1970. It is later than what was ruled
    /// before, whatever the clocks of other servers say.
    pub fn take(&mut self, act: &Act, now: u64) {
        match act {
            Act::SetRole(_, role) => self.role.set(*role, now),
            Act::SetMuted(_, is_muted) => self.muted.set(*is_muted, now),
            Act::Allow(_) => self.allowed.set(true, now),
            Act::Ban(_, reason) => self.banned.set(Some(line(reason)), now),
            Act::Unban(_) => self.banned.set(None, now),
            Act::Invite(..) => {}
        }
    }

    /// Takes in what was ruled elsewhere: of each part the later one, and the stricter one where
    /// both have the same date. The order in which rulings are merged does not matter.
    pub fn merge(&mut self, other: &Self) {
        self.role.merge(&other.role, |new, old| new < old);
        self.muted.merge(&other.muted, |new, old| new > old);
        self.allowed.merge(&other.allowed, |new, old| new < old);
        self.banned.merge(&other.banned, |new, old| new > old);
    }
}

impl<T: Clone + Default + PartialEq> Dated<T> {
    /// What was known without a date.
    pub fn undated(is: T) -> Self {
        let at = if is == T::default() { 0 } else { UNDATED };
        Self { is, at }
    }

    pub fn is_open(&self) -> bool {
        *self == Self::default()
    }

    /// Whether it has a date that a clock can show, unless nothing was ruled.
    #[cfg(feature = "bus")]
    pub fn is_dated(&self) -> bool {
        let is_date = (1..=DATE_MAX).contains(&self.at);
        is_date || self.is_open()
    }

    /// What was ruled up to some time, in milliseconds since 1970.
    #[cfg(feature = "bus")]
    pub fn until(&self, time: u64) -> Self {
        if self.at <= time { self.clone() } else { Self::default() }
    }

    fn set(&mut self, is: T, now: u64) {
        *self = Self { is, at: now.max(self.at.saturating_add(1)) };
    }

    fn merge(&mut self, other: &Self, is_stricter: impl Fn(&T, &T) -> bool) {
        let is_newer = other.at > self.at;
        if is_newer || (other.at == self.at && is_stricter(&other.is, &self.is)) {
            self.clone_from(other);
        }
    }
}

/// A reason, as one line; empty without one.
pub fn line(reason: &str) -> String {
    if reason.is_empty() { String::new() } else { ChatLine::clipped(reason).into() }
}

/// The time, in milliseconds since 1970.
pub fn now_ms() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use sightline_protocol::fingerprint::KeyFingerprint;

    use super::{super::changes::Subject, *};

    const ADA: KeyFingerprint = KeyFingerprint([1; 10]);

    fn act(number: u8) -> Act {
        match number % 8 {
            0 => Act::SetRole(ADA, Role::Visitor),
            1 => Act::SetRole(ADA, Role::Owner),
            2 => Act::SetMuted(ADA, true),
            3 => Act::SetMuted(ADA, false),
            4 => Act::Allow(ADA),
            5 => Act::Ban(Subject::Key(ADA), "rude".to_owned()),
            6 => Act::Ban(Subject::Key(ADA), "again".to_owned()),
            _ => Act::Unban(Subject::Key(ADA)),
        }
    }

    fn ruling(acts: &[(u8, u64)]) -> Ruling {
        let mut ruling = Ruling::default();
        acts.iter().for_each(|(number, now)| ruling.take(&act(*number), *now));
        ruling
    }

    fn merged(rulings: &[&Ruling]) -> Ruling {
        let mut merged = Ruling::default();
        rulings.iter().for_each(|ruling| merged.merge(ruling));
        merged
    }

    proptest! {
        /// Servers hear of rulings in any order, and more than once.
        #[test]
        fn servers_agree_whatever_order_they_hear_rulings_in(
            acts in prop::array::uniform3(prop::collection::vec((0_u8..8, 0_u64..6), 0..6)),
        ) {
            let [one, two, three] = acts.map(|acts| ruling(&acts));
            let expected = merged(&[&one, &two, &three]);
            for other in [
                merged(&[&three, &two, &one]),
                merged(&[&two, &merged(&[&three, &one]), &two]),
                merged(&[&merged(&[&one, &two]), &merged(&[&one, &three])]),
            ] {
                prop_assert_eq!(&other, &expected);
            }
        }
    }

    #[test]
    fn two_moderators_who_act_at_once_both_count() {
        let (one, other) = (ruling(&[(2, 10)]), ruling(&[(5, 10)]));
        let both = merged(&[&one, &other]);
        assert!(both.muted.is && both.banned.is.is_some());
        let lifted = merged(&[&ruling(&[(7, 10)]), &other]);
        assert!(lifted.banned.is.is_some(), "at the same time the stricter one counts");
    }

    #[test]
    fn who_knows_of_a_ruling_can_lift_it_whatever_the_clocks_say() {
        let mut ruling = ruling(&[(5, 5_000)]);
        ruling.take(&act(7), 3);
        assert_eq!((ruling.banned.is, ruling.banned.at), (None, 5_001));
    }

    #[test]
    fn what_older_versions_noted_is_kept_until_something_is_ruled() {
        let before = Standing { role: Role::Moderator, is_muted: false, is_allowed: true };
        let before = Ruling::undated(before);
        assert_eq!(merged(&[&Ruling::default(), &before]).standing(), before.standing());
        let now = ruling(&[(0, 2)]);
        assert_eq!(merged(&[&before, &now]).role.is, Role::Visitor);
    }
}
