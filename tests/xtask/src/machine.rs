//! The date and the hardware of a run.

use std::{
    fs,
    process::Command,
    time::{SystemTime, UNIX_EPOCH},
};

use serde_json::{Value, json};

/// Date, processor, cores, memory and compiler, with a note for the reader.
pub fn describe(note: &str) -> Value {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
    let rustc = Command::new("rustc").arg("--version").output();
    json!({
        "date": date(seconds),
        "cpu": field("/proc/cpuinfo", "model name").unwrap_or_else(|| "unknown".into()),
        "cores": std::thread::available_parallelism().map_or(0, usize::from),
        "memory": field("/proc/meminfo", "MemTotal").unwrap_or_default(),
        "rustc": rustc.map_or_else(|_| String::new(), |output| {
            String::from_utf8_lossy(&output.stdout).trim().to_owned()
        }),
        "note": note,
    })
}

/// A folder name that sorts by date, such as `2026-11-22-epyc-7763-64`. The maker's name is left
/// out.
pub fn folder_name(machine: &Value) -> String {
    let text = |key: &str| machine[key].as_str().unwrap_or_default();
    let cpu = text("cpu").replace("(R)", " ").replace("(TM)", " ").to_lowercase();
    let words = cpu
        .split(|c: char| !c.is_ascii_alphanumeric())
        .filter(|word| !["", "amd", "intel"].contains(word));
    let words: Vec<&str> = words.take(3).collect();
    format!("{}-{}", text("date"), words.join("-"))
}

/// The value of the first line `KEY : VALUE` of a file.
fn field(path: &str, key: &str) -> Option<String> {
    let text = fs::read_to_string(path).ok()?;
    let line = text.lines().find(|line| line.starts_with(key))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// The day of a time in UTC, as `YYYY-MM-DD`.
///
/// Source: Howard Hinnant, *chrono-Compatible Low-Level Date Algorithms*, `civil_from_days`.
fn date(unix_seconds: u64) -> String {
    // Years begin in March and come in eras of 400, which have 146,097 days each.
    let days = unix_seconds / 86_400 + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let march_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * march_month + 2) / 5 + 1;
    let month = if march_month < 10 { march_month + 3 } else { march_month - 9 };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        let day = |days: u64| date(days * 86_400 + 86_399);
        assert_eq!(day(0), "1970-01-01");
        assert_eq!([day(11_016), day(11_017)], ["2000-02-29", "2000-03-01"]);
        assert_eq!([day(20_453), day(20_454)], ["2025-12-31", "2026-01-01"]);
    }

    #[test]
    fn folders_are_called_by_date_and_processor() {
        let machine = json!({ "date": "2026-11-22", "cpu": "AMD EPYC 7763 64-Core Processor" });
        assert_eq!(folder_name(&machine), "2026-11-22-epyc-7763-64");
        let machine = json!({ "date": "2026-11-22", "cpu": "Intel(R) Core(TM) i7-8550U" });
        assert_eq!(folder_name(&machine), "2026-11-22-core-i7-8550u");
    }
}
