//! The reports of one trace under several policies, or with several kinds of TBVs, side by side.

use std::{fmt, time::Duration};

use serde::Serialize;
use sightline_engine::{Policy, TbvShape, Validity};

use super::report::{OracleReport, ReplayReport};

/// The reports of one trace, one for each policy or kind of TBV. It prints as a table with a row
/// for each. *To* and *from* are means over clients; *worst* is the client that gets most bytes.
#[derive(Clone, Debug, Default, Serialize)]
#[serde(transparent)]
pub struct Comparison {
    /// The rows, in the order in which they are printed.
    pub reports: Vec<ReplayReport>,
}

impl Comparison {
    /// What servers do today, and what this one does: from sending everything to TBVs. With each
    /// policy stands whether live clients report by exception. TBVs with reports at every tick are
    /// those of Sudarsky and Gotsman (1996).
    pub const POLICIES: [(Policy, bool); 9] = [
        (Policy::Broadcast, false),
        (Policy::Radius(20.0), false),
        (Policy::Grid(16.0), false),
        (Policy::Region { edge: 16.0, margin: 2.0 }, false),
        (Policy::Room { doors: 0 }, false),
        (Policy::Room { doors: 1 }, false),
        (Policy::Pvs, false),
        (Policy::Tbv, false),
        (Policy::Tbv, true),
    ];

    /// The kinds of TBVs: by what bounds them in space, and by how long they last.
    pub const TBVS: [(TbvShape, Validity); 7] = [
        (TbvShape::Reach, Validity::UntilLeft),
        (TbvShape::Reach, Validity::Maximal),
        (TbvShape::Reach, Validity::Adaptive),
        (TbvShape::Reach, HALF_A_SECOND),
        (TbvShape::Sphere, Validity::Maximal),
        (TbvShape::Sphere, Validity::Adaptive),
        (TbvShape::Sphere, HALF_A_SECOND),
    ];
}

const HALF_A_SECOND: Validity = Validity::Constant(Duration::from_millis(500));

/// A column: its heading, and the figure in it.
type Column = (&'static str, fn(&ReplayReport) -> String);

const COLUMNS: [Column; 19] = [
    ("held", |r| format!("{:.2}", r.held_mean)),
    ("msg/s to", |r| format!("{:.1}", r.messages_to_client)),
    ("B/s to", |r| format!("{:.0}", r.bytes_to_client)),
    ("worst", |r| format!("{:.0}", r.bytes_to_client_worst)),
    ("states/s to", |r| format!("{:.1}", r.updates_to_client)),
    ("msg/s from", |r| format!("{:.1}", r.messages_from_client)),
    ("B/s from", |r| format!("{:.0}", r.bytes_from_client)),
    ("asks/s", |r| format!("{:.1}", r.asks_per_s)),
    ("quiet %", |r| format!("{:.1}", r.quiet_share * 100.0)),
    ("course %", |r| format!("{:.1}", r.course_share * 100.0)),
    ("hidden reports %", |r| oracle(r, |o| format!("{:.2}", o.hidden_reports * 100.0))),
    ("misses", |r| oracle(r, |o| o.misses.to_string())),
    ("over-send", |r| oracle(r, |o| format!("{:.2}", o.over_send))),
    ("horizon", |r| oracle(r, |o| format!("{:.2}", o.over_send_horizon))),
    ("promise cm", |r| oracle(r, |o| format!("{:.1}", o.promised_error_p99_m * 100.0))),
    ("deg", |r| oracle(r, |o| format!("{:.1}", o.promised_error_p99_deg))),
    ("error cm", |r| oracle(r, |o| format!("{:.1}", o.shown_error_p99_m * 100.0))),
    ("age ms", |r| oracle(r, |o| format!("{:.0}", o.age_mean_ms))),
    ("tick ms, p99", |r| format!("{:.3}, {:.3}", r.tick_cpu_median_ms, r.tick_cpu_p99_ms)),
];

fn oracle(report: &ReplayReport, figure: impl Fn(&OracleReport) -> String) -> String {
    report.oracle.as_ref().map_or_else(|| "-".to_owned(), figure)
}

impl Comparison {
    /// The name of a row. It says what differs between the rows with TBVs.
    fn name(&self, report: &ReplayReport) -> String {
        let tbv = Policy::Tbv.to_string();
        if report.policy != tbv {
            return report.policy.clone();
        }
        let is_other = |other: &ReplayReport| {
            other.policy == tbv
                && (&other.shape, &other.validity) != (&report.shape, &report.validity)
        };
        let mut name = tbv.clone();
        if self.reports.iter().any(is_other) {
            name = format!("{name}, {}, {}", report.shape, report.validity);
        }
        if report.by_exception { name } else { format!("{name}, every tick") }
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let row = |report: &ReplayReport| {
            let figures = COLUMNS.iter().map(|(_, figure)| figure(report));
            [self.name(report)].into_iter().chain(figures).collect()
        };
        let names = COLUMNS.iter().map(|(name, _)| (*name).to_owned());
        let mut lines: Vec<Vec<String>> =
            vec![["policy".to_owned()].into_iter().chain(names).collect()];
        lines.extend(self.reports.iter().map(row));
        let width = |column: usize| lines.iter().map(|line| line[column].len()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..=COLUMNS.len()).map(width).collect();
        for line in &lines {
            write!(f, "{:<1$}", line[0], widths[0])?;
            for (figure, width) in line.iter().zip(&widths).skip(1) {
                write!(f, "  {figure:>width$}")?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
