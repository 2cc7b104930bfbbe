//! The events of a run, as CSV.

use std::{io, time::Duration};

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum What {
    /// The server told the viewer of the avatar; an update at the same time says where it is.
    Enter,
    /// The server told the viewer that the avatar is gone, or the viewer itself left.
    Leave,
    /// The server sent the viewer the avatar's state.
    Update,
    /// The server sent the avatar's client an ask.
    Ask,
    /// The server took in a report of the avatar's client.
    Report,
}

impl What {
    fn word(self) -> &'static str {
        match self {
            Self::Enter => "enter",
            Self::Leave => "leave",
            Self::Update => "update",
            Self::Ask => "ask",
            Self::Report => "report",
        }
    }
}

/// Writes events as they happen; or does nothing.
pub(super) struct Dump<'a> {
    to: Option<io::BufWriter<&'a mut dyn io::Write>>,
}

impl<'a> Dump<'a> {
    pub(super) fn new(to: Option<&'a mut dyn io::Write>) -> io::Result<Self> {
        let mut to = to.map(|to| io::BufWriter::with_capacity(1 << 16, to));
        if let Some(to) = &mut to {
            io::Write::write_all(to, b"t_ms,viewer,avatar,what\n")?;
        }
        Ok(Self { to })
    }

    /// Times are those at the server, in whole milliseconds. Ids are the trace's.
    pub(super) fn write(
        &mut self,
        at: Duration,
        viewer: Option<u32>,
        avatar: u32,
        what: What,
    ) -> io::Result<()> {
        use io::Write as _;
        let Some(to) = &mut self.to else { return Ok(()) };
        let (t_ms, word) = (at.as_millis(), what.word());
        match viewer {
            Some(viewer) => writeln!(to, "{t_ms},{viewer},{avatar},{word}"),
            None => writeln!(to, "{t_ms},,{avatar},{word}"),
        }
    }

    pub(super) fn finish(&mut self) -> io::Result<()> {
        self.to.as_mut().map_or(Ok(()), io::Write::flush)
    }
}
