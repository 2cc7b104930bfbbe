//! What several servers share of people: rulings.

use tokio::sync::mpsc;

use super::{
    People,
    changes::{Act, Change, Subject},
    ruling::{Ruling, line},
};

/// How many changes may wait to be written before what other servers say has to wait.
const CHANGES_MAX: usize = 4_096;

impl People {
    /// Tells from now on of whom something is ruled about by this server. Only the first who asks
    /// is told.
    pub(crate) fn follow_rulings(&self) -> Option<mpsc::UnboundedReceiver<Subject>> {
        let (told, hears) = mpsc::unbounded_channel();
        self.shared.ruled.set(told).is_ok().then_some(hears)
    }

    /// All of whom something was ruled about.
    pub(crate) fn ruled(&self) -> Vec<Subject> {
        self.shared.standings().ruled()
    }

    /// About how many something was ruled.
    pub(crate) fn ruled_count(&self) -> usize {
        self.shared.standings().ruled_count()
    }

    /// What was ruled about somebody.
    pub(crate) fn ruling(&self, subject: &Subject) -> Ruling {
        self.shared.standings().ruling(subject)
    }

    /// Takes in what was ruled elsewhere. Returns what was ruled before, if that was something
    /// else.
    pub(crate) fn merge(&self, author: &str, subject: Subject, other: &Ruling) -> Option<Ruling> {
        let mut standings = self.shared.standings();
        let before = standings.ruling(&subject);
        standings.apply(&Change::Rule(subject, other.clone()));
        let after = standings.ruling(&subject);
        if after == before {
            return None;
        }
        let mut pending = self.shared.pending();
        for act in after.acts_since(&before, subject) {
            let reason = if let Act::Ban(_, reason) = &act { reason } else { "" };
            pending.changes.push(Change::audit(author, &act, reason));
        }
        pending.changes.push(Change::Rule(subject, after));
        Some(before)
    }

    /// Whether so much waits to be written that what other servers say has to wait.
    pub(crate) fn is_behind(&self) -> bool {
        self.shared.pending().changes.len() > CHANGES_MAX
    }
}

impl Ruling {
    /// Whether a server can have made it, whatever its clock says.
    pub fn is_sound(&self) -> bool {
        let Self { role, muted, allowed, banned } = self;
        let is_line = banned.is.as_ref().is_none_or(|reason| *reason == line(reason));
        let is_dated = role.is_dated() && muted.is_dated() && allowed.is_dated();
        is_line && is_dated && banned.is_dated()
    }

    /// Those of its parts that were ruled up to some time, in milliseconds since 1970.
    pub fn until(&self, time: u64) -> Self {
        Self {
            role: self.role.until(time),
            muted: self.muted.until(time),
            allowed: self.allowed.until(time),
            banned: self.banned.until(time),
        }
    }

    /// What leads to it from what was ruled about the subject before.
    pub fn acts_since(&self, before: &Self, subject: Subject) -> Vec<Act> {
        let mut acts = Vec::new();
        if let Subject::Key(key) = subject {
            if self.role.is != before.role.is {
                acts.push(Act::SetRole(key, self.role.is));
            }
            if self.muted.is != before.muted.is {
                acts.push(Act::SetMuted(key, self.muted.is));
            }
            if self.allowed.is && !before.allowed.is {
                acts.push(Act::Allow(key));
            }
        }
        match (&before.banned.is, &self.banned.is) {
            (before, Some(reason)) if before.as_ref() != Some(reason) => {
                acts.push(Act::Ban(subject, reason.clone()));
            }
            (Some(_), None) => acts.push(Act::Unban(subject)),
            _ => {}
        }
        acts
    }
}
