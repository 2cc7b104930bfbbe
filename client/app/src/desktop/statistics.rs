//! The line of statistics, for those who ask.

use std::time::{Duration, Instant};

use crate::net::Session;

/// How often the line is renewed.
const RENEWED: Duration = Duration::from_millis(500);

/// Counts pictures, and says how the connection does.
#[derive(Default)]
pub(super) struct Statistics {
    pub(super) is_shown: bool,
    since: Option<Instant>,
    pictures: u32,
    /// Pictures drawn per second, in the last interval.
    per_s: f32,
    line: String,
}

impl Statistics {
    /// Counts a picture that was drawn anew.
    pub(super) fn count(&mut self, now: Instant) {
        self.pictures += 1;
        self.since.get_or_insert(now);
    }

    /// The line, if it is shown. `seen` is the number of avatars in sight.
    pub(super) fn line(
        &mut self,
        session: Option<&Session>,
        seen: usize,
        now: Instant,
    ) -> Option<String> {
        let since = *self.since.get_or_insert(now);
        let elapsed = now.saturating_duration_since(since);
        if elapsed >= RENEWED {
            self.per_s = self.pictures as f32 / elapsed.as_secs_f32();
            (self.since, self.pictures) = (Some(now), 0);
            self.line = self.described(session, seen);
        }
        self.is_shown.then(|| self.line.clone())
    }

    fn described(&self, session: Option<&Session>, seen: usize) -> String {
        let pictures = format!("{:.0} pictures a second", self.per_s);
        let Some(stats) = session.map(Session::stats) else { return pictures };
        let state = match stats.reporting_state {
            Some(state) => state.to_string(),
            None => "outside".to_owned(),
        };
        let [rate_in, rate_out] = [stats.udp_rate_in, stats.udp_rate_out].map(|rate| rate / 1.0e3);
        format!(
            "{pictures} | {state} | in {rate_in:.1}, out {rate_out:.1} kB/s | told of {}, sees {seen} \
             | round trip {} ms",
            stats.visible,
            stats.round_trip.as_millis()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_counted_over_half_a_second_and_shown_on_demand() {
        let start = Instant::now();
        let mut statistics = Statistics::default();
        let at = |i: u64| start + Duration::from_millis(25 * i);
        for i in 0..=20 {
            statistics.count(at(i));
            assert_eq!(statistics.line(None, 0, at(i)), None);
        }
        statistics.is_shown = true;
        assert_eq!(statistics.line(None, 0, at(21)).as_deref(), Some("42 pictures a second"));
        assert_eq!(statistics.line(None, 0, at(61)).as_deref(), Some("0 pictures a second"));
    }
}
