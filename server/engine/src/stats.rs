//! What the engine counts.

use std::ops::AddAssign;

/// How often each event happened since the engine was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Stats {
    /// TBVs that ended.
    pub expiries: u64,
    /// TBVs that came into view.
    pub reveals: u64,
    /// Asks that were repeated because no answer came, and live clients that were asked because
    /// they stalled.
    pub repeats: u64,
    /// Reports accepted.
    pub reports: u64,
    /// Reports of live clients whose avatars had departed from their courses, as far as the engine
    /// knows what they may leave unsaid. Other reports answer an ask or an order, or keep alive.
    pub departures: u64,
    /// Times that the host put an avatar elsewhere, or pushed it:
    /// [`Input::Relocate`](crate::Input::Relocate).
    pub impulses: u64,
    /// Reports refused.
    pub refusals: u64,
    /// Refused reports whose place no way leads to that is short enough, such as one through a
    /// wall.
    pub walls: u64,
    /// Clients dropped.
    pub drops: u64,
}

impl AddAssign for Stats {
    fn add_assign(&mut self, more: Self) {
        let Self { expiries, reveals, repeats, reports, departures, .. } = more;
        let Self { impulses, refusals, walls, drops, .. } = more;
        self.expiries += expiries;
        self.reveals += reveals;
        self.repeats += repeats;
        self.reports += reports;
        self.departures += departures;
        self.impulses += impulses;
        self.refusals += refusals;
        self.walls += walls;
        self.drops += drops;
    }
}

/// How many clients are in each reporting state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counts {
    /// Live clients. They report by exception or at every tick:
    /// [`Config::reports_by_exception`](crate::Config::reports_by_exception).
    pub live: usize,
    /// Silent clients.
    pub quiet: usize,
    /// Clients that owe a report.
    pub asked: usize,
}
