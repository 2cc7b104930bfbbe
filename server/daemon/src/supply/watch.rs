//! Notices that files change. It looks at them a few times a second, which works on every file
//! system, and for files that editors replace.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::PathBuf,
    sync::Mutex,
    thread::sleep,
    time::{Duration, Instant, SystemTime},
};

/// The time between two looks.
const LOOK_INTERVAL: Duration = Duration::from_millis(300);
/// A change is over when nothing has changed for this long: programs write large files in pieces.
const QUIET: Duration = Duration::from_millis(500);

/// Files as they were at one moment, to be compared with what they are later.
pub(super) struct Watched {
    known: Stamps,
    looked_at: Mutex<(Instant, bool)>,
}

/// When each file was written, and its length; `None` for one that is not there.
type Stamps = BTreeMap<PathBuf, Option<(SystemTime, u64)>>;

impl Watched {
    /// Files as they are now.
    pub(super) fn now(files: &BTreeSet<PathBuf>) -> Self {
        Self { known: stamps(files.iter()), looked_at: Mutex::new((Instant::now(), false)) }
    }

    /// Whether a file differs from what it was. It may be called often: the files are not looked at
    /// each time.
    pub(super) fn has_changed(&self) -> bool {
        let Ok(mut looked_at) = self.looked_at.try_lock() else { return false };
        let (at, has_changed) = &mut *looked_at;
        if !*has_changed && at.elapsed() >= LOOK_INTERVAL {
            (*at, *has_changed) = (Instant::now(), stamps(self.known.keys()) != self.known);
        }
        *has_changed
    }

    /// Waits until a file has changed and the change is over. Returns false when it is told to end
    /// before.
    pub(super) fn wait(&self, ends: &dyn Fn() -> bool) -> bool {
        while !self.has_changed() {
            if ends() {
                return false;
            }
            sleep(LOOK_INTERVAL);
        }
        let mut before = stamps(self.known.keys());
        loop {
            sleep(QUIET);
            if ends() {
                return false;
            }
            let now = stamps(self.known.keys());
            if now == before {
                return true;
            }
            before = now;
        }
    }
}

fn stamps<'a>(files: impl Iterator<Item = &'a PathBuf>) -> Stamps {
    let stamp = |path: &PathBuf| {
        let metadata = fs::metadata(path).ok()?;
        Some((metadata.modified().ok()?, metadata.len()))
    };
    files.map(|path| (path.clone(), stamp(path))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_is_told_when_it_is_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("house.gltf");
        fs::write(&path, "1").unwrap();
        let files = BTreeSet::from([path.clone(), folder.path().join("house.rooms.toml")]);
        let watched = Watched::now(&files);
        let ends_at = Instant::now() + LOOK_INTERVAL * 2;
        assert!(!watched.wait(&|| Instant::now() > ends_at), "nothing has changed");
        let writer = std::thread::spawn(move || {
            for length in 2..6 {
                fs::write(&path, "x".repeat(length)).unwrap();
                sleep(QUIET / 3);
            }
        });
        assert!(watched.wait(&|| false));
        assert!(writer.is_finished(), "the change was not over");
        assert!(watched.has_changed());
        let watched = Watched::now(&files);
        fs::write(folder.path().join("house.rooms.toml"), "").unwrap();
        assert!(watched.wait(&|| false), "a file that was not there");
    }
}
