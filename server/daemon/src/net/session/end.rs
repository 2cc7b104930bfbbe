//! Why sessions end.

use sightline_protocol::{DecodeError, message::Refusal};

use super::super::transport::TransportError;
use crate::operate::Reason;

/// Why a session ended.
#[derive(Debug, thiserror::Error)]
pub enum SessionEnd {
    /// The connection broke.
    #[error("connection lost: {0}")]
    Lost(String),
    /// The client said goodbye.
    #[error("left")]
    Left,
    /// The client was not admitted.
    #[error("refused: {0}")]
    Refused(Refusal),
    /// The server sent a goodbye.
    #[error("dismissed by the server")]
    Dismissed,
    /// The server closes.
    #[error("the server is closing")]
    Closing,
    /// The session panicked.
    #[error("a fault of the server ended the session")]
    Failed,
    /// The client sent bytes that no client sends.
    #[error("{0}")]
    Malformed(#[from] DecodeError),
    /// The client reached a limit.
    #[error("{1}")]
    Limit(Reason, &'static str),
    /// The client broke the protocol.
    #[error("{0}")]
    Breach(&'static str),
}

impl SessionEnd {
    /// Why the server ended the session, if the client gave cause.
    pub fn refusal(&self) -> Option<Reason> {
        match self {
            Self::Limit(reason, _) => Some(*reason),
            Self::Malformed(_) => Some(Reason::Malformed),
            Self::Breach(_) => Some(Reason::Breach),
            _ => None,
        }
    }

    /// Whether the client did nothing to end the session, and finds its avatar when it comes back.
    pub fn may_return(&self) -> bool {
        matches!(self, Self::Lost(_) | Self::Failed)
    }
}

impl From<TransportError> for SessionEnd {
    fn from(error: TransportError) -> Self {
        match error {
            TransportError::Closed => Self::Left,
            TransportError::Lost(reason) => Self::Lost(reason),
            #[cfg(feature = "web")]
            TransportError::Breach(what) => Self::Breach(what),
        }
    }
}
