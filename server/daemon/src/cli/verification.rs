//! The verification of a world, for `inspect --verify`.

use std::{fmt::Write, time::Instant};

use serde::Serialize;
use sightline_cli::progress::Progress;
use sightline_compiler::verify::{
    self, LooseEntries, Miss, PairCounts, PvsTally, VerifyOptions, VerifyReport, VerifySummary,
};
use sightline_world::World;

/// The figures of a verification: the principal ones, then all of them.
#[derive(Serialize)]
pub struct VerificationFigures {
    #[serde(flatten)]
    principal: VerifySummary,
    verification: Details,
}

#[derive(Serialize)]
struct Details {
    #[serde(flatten)]
    report: VerifyReport,
    seed: u64,
    seconds: f64,
}

impl VerificationFigures {
    /// Verifies a world.
    ///
    /// # Errors
    /// When the world cannot be verified.
    pub fn find(world: &World, options: &VerifyOptions) -> anyhow::Result<Self> {
        let (progress, start) = (Progress::new(), Instant::now());
        let report = verify::verify(world, options, &|stage, share| progress.show(stage, share));
        progress.finish();
        let report = report?;
        let seconds = start.elapsed().as_secs_f64();
        Ok(Self {
            principal: report.summary(),
            verification: Details { report, seed: options.seed, seconds },
        })
    }

    /// Fails when there is a miss.
    ///
    /// # Errors
    /// When a visible pair is missing from the PVS.
    pub fn verdict(&self) -> anyhow::Result<()> {
        let VerifyReport { by_volume, by_cell, .. } = &self.verification.report;
        let (misses, sight) = (self.principal.misses, by_volume.sight + by_cell.sight);
        anyhow::ensure!(misses == 0, "the PVS denies {misses} of {sight} pairs in sight");
        Ok(())
    }

    /// A table of the figures, with those of the map's own PVS beside them, and the first misses.
    pub fn table(&self) -> String {
        let Details { report, seed, seconds } = &self.verification;
        let mut table = String::new();
        let _ = writeln!(table, "\nverified in {seconds:.1} s, seed {seed}");
        let _ = writeln!(table, "space sampled      {}", report.sampled);
        let has_own = report.by_volume.own.is_some();
        let own = if has_own { "the map's own" } else { "" };
        let _ = writeln!(table, "{:<18} {:>14} {own:>14}", "", "ours");
        put_pairs(&mut table, "by volume", &report.by_volume);
        put_pairs(&mut table, "by cell", &report.by_cell);
        let entries = |what: &dyn Fn(&LooseEntries) -> String| {
            let own = report.own_entries.as_ref().map(what);
            [what(&report.entries), own.unwrap_or_default()]
        };
        put(&mut table, "looseness", entries(&|e| percent(e.share(), 2)));
        if let Some(parted) = report.entries.parted {
            let text = format!("{parted} of {}", report.entries.loose);
            put(&mut table, "  fuzzy parts", [text, String::new()]);
        }
        put(&mut table, "  entries tried", entries(&|e| e.entries.to_string()));
        put(&mut table, "  lines each", entries(&|e| format!("<= {}", e.lines_max)));
        put(&mut table, "  lines in all", entries(&|e| e.lines.to_string()));
        for (name, pairs) in [("volume", &report.by_volume), ("cell", &report.by_cell)] {
            put_misses(&mut table, &format!("missed, by {name}"), Some(&pairs.ours));
            put_misses(&mut table, &format!("missed by the map, by {name}"), pairs.own.as_ref());
        }
        table
    }
}

fn put_pairs(table: &mut String, how: &str, pairs: &PairCounts) {
    let share =
        |count: u64| percent((pairs.pairs > 0).then(|| count as f64 / pairs.pairs as f64), 3);
    let both = |what: &dyn Fn(&PvsTally) -> String| {
        [what(&pairs.ours), pairs.own.as_ref().map(what).unwrap_or_default()]
    };
    let alone = |what: String| [what, String::new()];
    put(table, how, alone(format!("{} pairs", pairs.pairs)));
    if pairs.closed > 0 {
        put(table, "  and closed off", alone(pairs.closed.to_string()));
    }
    put(table, "  P(sight)", alone(share(pairs.sight)));
    put(table, "  P(PVS)", both(&|tally| share(tally.pvs)));
    let over_send = |tally: &PvsTally| match pairs.over_send(tally) {
        Some(ratio) => format!("{ratio:.3}"),
        None => "-".to_owned(),
    };
    put(table, "  over-send", both(&over_send));
    put(table, "  misses", both(&|tally| tally.misses.to_string()));
    if pairs.grazing > 0 {
        put(table, "  grazing, no miss", alone(pairs.grazing.to_string()));
    }
}

fn put(table: &mut String, name: &str, [ours, own]: [String; 2]) {
    let line = format!("{name:<18} {ours:>14} {own:>14}");
    let _ = writeln!(table, "{}", line.trim_end());
}

fn put_misses(table: &mut String, name: &str, tally: Option<&PvsTally>) {
    for Miss { from, to, places } in tally.iter().flat_map(|tally| &tally.first_misses) {
        let [a, b] = places.map(|place| place.map_or("none".to_owned(), |place| place.to_string()));
        let _ = writeln!(
            table,
            "{name}: {},{},{} sees {},{},{} (places {a} and {b})",
            from.x, from.y, from.z, to.x, to.y, to.z
        );
    }
}

fn percent(share: Option<f64>, digits: usize) -> String {
    share.map_or("-".to_owned(), |share| format!("{:.digits$} %", share * 100.0))
}
