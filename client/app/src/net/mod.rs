//! The connection to a server, the download of its worlds, as a whole or in pieces, and the cache
//! of worlds.
//!
//! A [`Dialer`] makes [`Session`]s within a tokio runtime. A [`Connector`] makes them for a thread
//! that has none. A session runs by itself, and its methods never wait for the network. When its
//! link breaks, it comes back by itself.

mod cache;
mod connector;
mod control_stream;
mod dialer;
mod download;
mod error;
mod passage;
mod piece_store;
mod piece_traffic;
mod returning;
mod session;
mod trust;

pub use connector::{Connector, Joining};
pub use dialer::{ConnectOptions, Dialer};
pub use error::ConnectError;
pub use passage::{JoinProgress, ProgressListener};
pub use session::{Session, SessionState, SessionStats};
pub use trust::{Trust, TrustError};

/// The file where the programs of this user keep its key; `None` when there is no home folder.
pub fn identity_of_user() -> Option<std::path::PathBuf> {
    trust::user_folders().map(|folders| folders.data_dir().join("visitor.pem"))
}

/// The folder where the programs of this user keep worlds; `None` when there is no home folder.
pub fn world_folder_of_user() -> Option<std::path::PathBuf> {
    trust::user_folders().map(|folders| folders.cache_dir().join("worlds"))
}
