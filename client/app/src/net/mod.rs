//! The connection to a server, the world's download and its cache.
//!
//! A [`Dialer`] makes [`Session`]s, in a tokio runtime. [`connect_blocking`] makes one for a thread
//! that has none. A session runs by itself; its methods never wait for the network.

mod cache;
mod dialer;
mod session;
mod trust;

pub use dialer::{ConnectError, ConnectOptions, Dialer, DownloadProgress, connect_blocking};
pub use session::{Session, SessionStats};
pub use trust::{Trust, TrustError};

/// Where the user's programs keep worlds; `None` when there is no home folder.
pub fn world_folder_of_user() -> Option<std::path::PathBuf> {
    user_folders().map(|folders| folders.cache_dir().join("worlds"))
}

fn user_folders() -> Option<directories::ProjectDirs> {
    directories::ProjectDirs::from("", "", "sightline")
}
