//! Whether there is a connection, when to try for one again, and what to tell the person meanwhile.

use std::time::{Duration, Instant};

use crate::net::{JoinProgress, SessionState};

/// The wait after the first failure. Each further one doubles it.
const WAIT_FIRST: Duration = Duration::from_secs(1);
const WAIT_MAX: Duration = Duration::from_secs(30);

/// The connection to a server, as the window knows it. A session comes back by itself when its link
/// breaks. This is about the time before there is a session, and after its end.
#[derive(Clone, Debug)]
pub(super) struct Link {
    /// The server, as the person named it.
    host: String,
    state: LinkState,
    /// The failures since the person was in the building.
    failures: u32,
}

#[derive(Clone, Debug)]
enum LinkState {
    /// An attempt to join is under way.
    Joining,
    /// There is a session.
    Joined,
    /// There is no connection. The next attempt begins at a moment.
    Waiting { reason: String, until: Instant },
    /// There is no connection, and another attempt would end as the last one did.
    Refused { title: &'static str, reason: String },
}

/// What a banner across the window says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Notice {
    pub(super) title: String,
    pub(super) note: String,
    /// How much of the work is done, from 0 to 1, where that is known.
    pub(super) share: Option<f32>,
}

impl Notice {
    fn new(title: &str, note: String) -> Self {
        Self { title: title.to_owned(), note, share: None }
    }
}

impl Link {
    /// No connection yet. The first attempt begins at once.
    pub(super) fn new(host: String, now: Instant) -> Self {
        let state = LinkState::Waiting { reason: String::new(), until: now };
        Self { host, state, failures: 0 }
    }

    /// Whether an attempt to join must begin now.
    pub(super) fn begins_attempt(&mut self, now: Instant) -> bool {
        let is_due = matches!(self.state, LinkState::Waiting { until, .. } if until <= now);
        if is_due {
            self.state = LinkState::Joining;
        }
        is_due
    }

    /// An attempt to join succeeded.
    pub(super) fn joined(&mut self) {
        (self.state, self.failures) = (LinkState::Joined, 0);
    }

    /// An attempt to join failed. Another one may succeed if it `may_pass`.
    pub(super) fn failed(&mut self, now: Instant, reason: String, may_pass: bool) {
        self.state = if may_pass {
            let wait = WAIT_FIRST.saturating_mul(1 << self.failures.min(8)).min(WAIT_MAX);
            self.failures += 1;
            LinkState::Waiting { reason, until: now + wait }
        } else {
            LinkState::Refused { title: "You cannot come in.", reason }
        };
    }

    /// The session has ended for good.
    pub(super) fn ended(&mut self, reason: String) {
        self.state = LinkState::Refused { title: "You have left the building.", reason };
    }

    /// The person asks for another attempt.
    pub(super) fn try_again(&mut self, now: Instant) {
        if let LinkState::Refused { reason, .. } | LinkState::Waiting { reason, .. } =
            &mut self.state
        {
            let reason = std::mem::take(reason);
            self.state = LinkState::Waiting { reason, until: now };
        }
    }

    /// Why there is no connection; `None` while there is one, or it is not known yet.
    pub(super) fn trouble(&self) -> Option<&str> {
        match &self.state {
            LinkState::Waiting { reason, .. } | LinkState::Refused { reason, .. } => Some(reason),
            LinkState::Joining | LinkState::Joined => None,
        }
    }

    /// What the banner says; `None` when all is well. `progress` is that of the attempt under way.
    pub(super) fn notice(&self, now: Instant, progress: Option<JoinProgress>) -> Option<Notice> {
        match &self.state {
            LinkState::Joined => None,
            LinkState::Joining => Some(self.attempt(progress.unwrap_or(JoinProgress::Connecting))),
            LinkState::Waiting { reason, until } => {
                let left = until.saturating_duration_since(now).as_secs_f32().ceil();
                let note = format!("{reason}. Trying again in {left:.0} s. Escape leaves.");
                Some(Notice::new("You are not in yet.", note))
            }
            LinkState::Refused { title, reason } => {
                let note = format!("{reason}. Home tries again, Escape leaves.");
                Some(Notice::new(title, note))
            }
        }
    }

    fn attempt(&self, progress: JoinProgress) -> Notice {
        match progress {
            JoinProgress::Connecting => {
                let title = format!("Connecting to {}", self.host);
                Notice::new(&title, "Escape leaves.".to_owned())
            }
            JoinProgress::Waiting(what) => {
                Notice::new("The server is getting ready", format!("It says: {what}"))
            }
            JoinProgress::Download { done, all } => {
                let megabytes = |bytes: u64| bytes as f64 / 1e6;
                let note = format!("{:.1} of {:.1} MB", megabytes(done), megabytes(all));
                let share = Some(done as f32 / all.max(1) as f32);
                Notice { share, ..Notice::new("Fetching the building", note) }
            }
            JoinProgress::Reading => Notice::new("Opening the building", String::new()),
        }
    }
}

/// What the banner says while too little of the building is here to be seen.
pub(super) fn arriving() -> Notice {
    Notice::new("Fetching the building", "Escape leaves.".to_owned())
}

/// What the banner says of a session; `None` when all is well.
pub(super) fn session_notice(state: &SessionState) -> Option<Notice> {
    match state {
        SessionState::Present => None,
        SessionState::MovingOver => {
            let note = "You will be in the new one in a moment.";
            Some(Notice::new("The building has changed.", note.to_owned()))
        }
        SessionState::Returning { reason, lost_for } => {
            let note = format!(
                "{reason}. Trying for {} s to reach it again. Escape leaves.",
                lost_for.as_secs()
            );
            Some(Notice::new("The server is lost.", note))
        }
        SessionState::Ended(reason) => {
            Some(Notice::new("You have left the building.", format!("{reason}. Escape leaves.")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(start: Instant, seconds: f32) -> Instant {
        start + Duration::from_secs_f32(seconds)
    }

    /// The waits between attempts that fail at once, in seconds, as a look every 100 ms finds them.
    fn waits(link: &mut Link, start: Instant, failures: usize) -> Vec<f32> {
        let (mut tenths, mut waits) = (0, Vec::new());
        while waits.len() < failures {
            let from = tenths;
            link.failed(after(start, tenths as f32 / 10.0), "gone".into(), true);
            while !link.begins_attempt(after(start, tenths as f32 / 10.0)) {
                tenths += 1;
            }
            waits.push((tenths - from) as f32 / 10.0);
        }
        waits
    }

    #[test]
    fn the_first_attempt_begins_at_once_and_later_ones_ever_later() {
        let now = Instant::now();
        let mut link = Link::new("host:1".into(), now);
        assert!(link.begins_attempt(now) && !link.begins_attempt(now), "one attempt at a time");
        let expected = [1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0];
        assert_eq!(waits(&mut link, now, 8), expected);
        link.joined();
        assert!(!link.begins_attempt(after(now, 1e6)));
        assert_eq!(waits(&mut link, now, 2), expected[..2], "who was in begins with short waits");
    }

    #[test]
    fn what_would_fail_again_waits_for_the_person() {
        let now = Instant::now();
        let mut link = Link::new("host:1".into(), now);
        link.begins_attempt(now);
        link.try_again(now);
        assert!(!link.begins_attempt(now), "an attempt is under way");
        let ends: [fn(&mut Link, Instant); 2] = [
            |link, now| link.failed(now, "full".into(), false),
            |link, _| link.ended("full".into()),
        ];
        for end in ends {
            end(&mut link, now);
            assert_eq!(link.trouble(), Some("full"));
            assert!(!link.begins_attempt(after(now, 1e6)));
            link.try_again(now);
            assert!(link.begins_attempt(now));
        }
    }

    #[test]
    fn the_banner_says_what_happens_and_vanishes_when_all_is_well() {
        let now = Instant::now();
        let mut link = Link::new("host:1".into(), now);
        link.begins_attempt(now);
        let title = |link: &Link, progress| link.notice(now, progress).map(|notice| notice.title);
        assert_eq!(title(&link, None).as_deref(), Some("Connecting to host:1"));
        let half = JoinProgress::Download { done: 1_000_000, all: 2_000_000 };
        let notice = link.notice(now, Some(half)).unwrap();
        assert_eq!((notice.note.as_str(), notice.share), ("1.0 of 2.0 MB", Some(0.5)));
        link.failed(now, "no answer".into(), true);
        let notice = link.notice(now, None).unwrap();
        assert_eq!(notice.note, "no answer. Trying again in 1 s. Escape leaves.");
        link.joined();
        assert_eq!((link.notice(now, None), link.trouble()), (None, None));
        link.ended("expelled".into());
        assert_eq!(title(&link, None).as_deref(), Some("You have left the building."));
    }

    #[test]
    fn a_session_that_is_not_present_has_a_banner() {
        assert_eq!(session_notice(&SessionState::Present), None);
        let lost_for = Duration::from_millis(7_900);
        let lost = SessionState::Returning { reason: "timed out".into(), lost_for };
        let notice = session_notice(&lost).unwrap();
        assert_eq!(notice.title, "The server is lost.");
        assert_eq!(notice.note, "timed out. Trying for 7 s to reach it again. Escape leaves.");
        assert!(session_notice(&SessionState::MovingOver).is_some());
    }
}
