//! The events of a run, as CSV with the header `t_ms,viewer,avatar,what`.

use std::{io, time::Duration};

use io::Write as _;

/// The kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EventKind {
    /// The server told the viewer of the avatar. An update of the same time says where it is.
    Enter,
    /// The server told the viewer that the avatar vanished, or the viewer itself left.
    Leave,
    /// The server sent the viewer the avatar's state.
    Update,
    /// The server sent the avatar's client an ask.
    Ask,
    /// The server received a report of the avatar's client.
    Report,
}

impl EventKind {
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

/// Writes events as they happen, if there is a writer to take them.
pub(super) struct Dump<'a> {
    writer: Option<io::BufWriter<&'a mut dyn io::Write>>,
}

impl<'a> Dump<'a> {
    /// Writes the header.
    pub(super) fn new(writer: Option<&'a mut dyn io::Write>) -> io::Result<Self> {
        let mut writer = writer.map(|writer| io::BufWriter::with_capacity(1 << 16, writer));
        if let Some(writer) = &mut writer {
            writer.write_all(b"t_ms,viewer,avatar,what\n")?;
        }
        Ok(Self { writer })
    }

    /// Writes an event. Its time is the server's, rounded down to a whole millisecond; its ids are
    /// the trace's. Messages between the server and the avatar's own client have no viewer.
    pub(super) fn write(
        &mut self,
        at: Duration,
        viewer: Option<u32>,
        avatar: u32,
        kind: EventKind,
    ) -> io::Result<()> {
        debug_assert!(viewer != Some(avatar), "nobody is told of itself");
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let (t_ms, word) = (at.as_millis(), kind.word());
        match viewer {
            Some(viewer) => writeln!(writer, "{t_ms},{viewer},{avatar},{word}"),
            None => writeln!(writer, "{t_ms},,{avatar},{word}"),
        }
    }

    /// Writes what is still in memory.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        self.writer.as_mut().map_or(Ok(()), io::Write::flush)
    }
}
