//! What the server refused, by reason.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Declares the reasons, and the names by which metrics have them.
macro_rules! reasons {
    ($($(#[$doc:meta])* $reason:ident = $name:literal,)*) => {
        /// Why something was refused: a limit was reached, or a peer did what no client does. A
        /// reason that is a setting has its name.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum Reason {
            $($(#[$doc])* $reason,)*
        }

        impl Reason {
            /// The names, in the order of the reasons.
            const NAMES: [&str; [$($name),*].len()] = [$($name),*];
        }
    };
}

reasons! {
    /// More connections than the server has room for.
    Connections = "connections_spare",
    /// More connections from one network than it may have.
    ConnectionsOfNetwork = "clients_per_address_max",
    /// A handshake that must first prove its address.
    Unproven = "handshakes_before_retry",
    /// A handshake or a first message that took too long.
    Hello = "hello_s",
    /// A client of another version.
    Version = "version",
    /// A client without a key.
    NoKey = "no_key",
    /// A client whose key or network is banned.
    Banned = "banned",
    /// A client that is not on the list, and has no invitation.
    NotInvited = "access",
    /// A client that came while the server was closing.
    Closing = "closing",
    /// A client for which there is no avatar.
    Clients = "clients_max",
    /// A client that came while the rate was below the full rate.
    Overload = "overload",
    /// A client that came while too many waited to enter.
    Entering = "entering_max",
    /// A client that came while too many others joined.
    Joining = "joining_max",
    /// A client that came while too many others of its network joined.
    JoiningOfNetwork = "joining_per_address_max",
    /// A client that took too long to enter.
    Enter = "enter_s",
    /// A request for pieces that a client took too long to receive.
    Download = "download_bytes_per_s",
    /// A request for pieces that waited, because its client had been sent all that it may be.
    Pieces = "piece_bytes_per_s",
    /// A piece, or the file, of a world whose geometry is private.
    PrivateGeometry = "private_geometry",
    /// A client that was silent for too long.
    Silence = "silence_s",
    /// A message beyond the client's budget, which was ignored.
    Messages = "messages_per_tick",
    /// A client that went on after its budget was spent.
    Flood = "messages_tolerated",
    /// A line of chat beyond the client's budget.
    Chat = "chat_per_s",
    /// A client for which too many messages waited.
    Outbox = "control_bytes_max",
    /// A tick at which a client's poses waited, because it had been sent all that it may be.
    SendBudget = "client_bytes_per_s",
    /// A client that took too long to read.
    Reading = "write_s",
    /// Bytes that are no message.
    Malformed = "malformed",
    /// A message at the wrong time.
    Breach = "breach",
    /// A line of the log about a peer.
    LogLine = "log_lines_per_s",
    /// An HTTP connection beyond the limit.
    HttpConnections = "http_connections_max",
    /// An HTTP connection from an address that has as many as it may.
    HttpOfAddress = "http_connections_per_address_max",
    /// An HTTP request beyond the limit.
    HttpRequests = "http_requests_per_s",
    /// A connection of a browser, while there are as many as may be.
    WebConnections = "web_connections_max",
    /// A connection of a browser from a network that has as many as it may.
    WebOfAddress = "web_connections_per_address_max",
    /// A request of a browser beyond the rate of its network.
    WebRequests = "web_requests_per_s",
    /// A visit by a page of another site.
    Origin = "web_origins",
}

/// How often something was refused, by reason.
#[derive(Debug)]
pub(crate) struct Refusals([AtomicU64; Reason::NAMES.len()]);

impl Default for Refusals {
    fn default() -> Self {
        Self(std::array::from_fn(|_| AtomicU64::new(0)))
    }
}

impl Refusals {
    /// Counts a refusal.
    pub(crate) fn count(&self, reason: Reason) {
        self.0[reason as usize].fetch_add(1, Relaxed);
    }

    /// All refusals by which a peer lost something: a line of the log, a handshake that goes on
    /// once the address is proven, and poses or pieces that wait are none of them.
    pub(crate) fn total(&self) -> u64 {
        let costs_nothing = [Reason::Unproven, Reason::LogLine, Reason::SendBudget, Reason::Pieces]
            .map(|reason| reason as usize);
        let counts = self.0.iter().enumerate();
        let lost = counts.filter(|(reason, _)| !costs_nothing.contains(reason));
        lost.map(|(_, count)| count.load(Relaxed)).sum()
    }

    /// The counts at present, by the names of reasons.
    pub(crate) fn counts(&self) -> impl Iterator<Item = (&'static str, u64)> + '_ {
        Reason::NAMES.into_iter().zip(self.0.iter().map(|count| count.load(Relaxed)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_reason_has_a_counter_and_a_name_of_its_own() {
        let refusals = Refusals::default();
        refusals.count(Reason::Connections);
        (0..3).for_each(|_| refusals.count(Reason::LogLine));
        let counts: Vec<_> = refusals.counts().collect();
        assert_eq!(counts.first(), Some(&("connections_spare", 1)));
        assert_eq!(counts[Reason::LogLine as usize], ("log_lines_per_s", 3));
        assert_eq!(refusals.total(), 1);
        let names: std::collections::BTreeSet<_> = counts.iter().map(|(name, _)| name).collect();
        assert_eq!(names.len(), counts.len());
    }
}
