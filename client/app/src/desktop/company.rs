//! Who else is in the building: nobody, the people of a session, or those of a server that the
//! window joins.

use std::time::Instant;

use super::link::{Link, Notice, session_notice};
use crate::net::{Connector, Joining, Session};

/// Who else is in the building.
pub(super) enum Company<'a> {
    /// Nobody: there is no server.
    Nobody,
    /// The people of a session that somebody else made. The visit ends with it.
    Guests(&'a Session),
    /// The people of a server.
    Server(Box<ServerLink>),
}

/// A server that the window joins.
pub(super) struct ServerLink {
    connector: Connector,
    link: Link,
    joining: Option<Joining>,
    session: Option<Session>,
    has_been_in: bool,
}

impl ServerLink {
    /// A server that the person calls `host`.
    pub(super) fn new(connector: Connector, host: String, now: Instant) -> Self {
        let link = Link::new(host, now);
        Self { connector, link, joining: None, session: None, has_been_in: false }
    }

    /// Goes on joining, or notices that the session has ended.
    fn poll(&mut self, now: Instant) {
        if let Some(reason) = self.session.as_ref().and_then(Session::end) {
            self.session = None;
            self.link.ended(reason);
        }
        if self.link.begins_attempt(now) {
            self.joining = Some(self.connector.join());
        }
        let Some(outcome) = self.joining.as_mut().and_then(Joining::outcome) else { return };
        self.joining = None;
        match outcome {
            Ok(session) => {
                (self.session, self.has_been_in) = (Some(session), true);
                self.link.joined();
            }
            Err(error) => self.link.failed(now, error.to_string(), error.may_pass()),
        }
    }

    fn notice(&self, now: Instant) -> Option<Notice> {
        let of_session = self.session.as_ref().and_then(|of| session_notice(&of.state()));
        of_session.or_else(|| self.link.notice(now, self.joining.as_ref().map(Joining::progress)))
    }
}

impl Company<'_> {
    /// Goes on joining, or notices that the session has ended.
    pub(super) fn poll(&mut self, now: Instant) {
        if let Self::Server(server) = self {
            server.poll(now);
        }
    }

    /// Asks for another attempt to join, where there is none under way.
    pub(super) fn try_again(&mut self, now: Instant) {
        if let Self::Server(server) = self {
            server.link.try_again(now);
        }
    }

    /// The session, while there is one.
    pub(super) fn session(&self) -> Option<&Session> {
        match self {
            Self::Nobody => None,
            Self::Guests(session) => Some(session),
            Self::Server(server) => server.session.as_ref(),
        }
    }

    /// Whether there is no server.
    pub(super) fn is_nobody(&self) -> bool {
        matches!(self, Self::Nobody)
    }

    /// What to tell of the connection; `None` when all is well.
    pub(super) fn notice(&self, now: Instant) -> Option<Notice> {
        match self {
            Self::Nobody => None,
            Self::Guests(session) => session_notice(&session.state()),
            Self::Server(server) => server.notice(now),
        }
    }

    /// Why the visit ended by itself; `None` while it goes on.
    pub(super) fn ended(&self) -> Option<String> {
        match self {
            Self::Guests(session) => session.end(),
            Self::Nobody | Self::Server(_) => None,
        }
    }

    /// Leaves. Returns why there was no connection at the end, if there was none, and whether there
    /// ever was one.
    pub(super) fn leave(self) -> (Option<String>, bool) {
        match self {
            Self::Nobody => (None, true),
            Self::Guests(session) => (session.end(), true),
            Self::Server(server) => {
                let ServerLink { connector, link, joining, session, has_been_in } = *server;
                let trouble = link.trouble().map(str::to_owned);
                drop(joining);
                if let Some(session) = session {
                    connector.leave(session);
                }
                connector.shut_down();
                (trouble, has_been_in)
            }
        }
    }
}
