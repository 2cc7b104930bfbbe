//! A client that fetches a world in pieces over a simulated link, in virtual time, and draws what
//! it has.

use std::{collections::VecDeque, time::Duration};

use glam::Vec3;
use sightline_client_core::fetching::{Outlook, PieceError, PieceFetcher, ShownBranch};
use sightline_renderer::{Camera, Frame, Renderer, streaming::shown_branches};
use sightline_world::{ReadError, WorldHead, WorldPieces};

/// The time from picture to picture.
pub const FRAME: Duration = Duration::from_millis(50);
/// The most bytes that may be asked for and not here yet.
const UNDER_WAY: usize = 192 * 1_024;
/// What a piece takes on the link beside its bytes: its number, its length, and a share of packets.
const PIECE_SPARE: usize = 8;
/// The share of a packet that carries bytes of a stream. The rest is headers.
const PACKED_SHARE: f64 = 1_400.0 / 1_500.0;
/// Round trips before the head can be asked for: the handshake, and the hello.
const GREETING: u32 = 2;

/// A link with a constant rate and delay.
#[derive(Clone, Copy, Debug)]
pub struct SimulatedLink {
    /// Bits each second towards the client.
    pub bits_per_s: f64,
    /// The delay one way.
    pub delay: Duration,
}

impl SimulatedLink {
    fn takes(&self, bytes: usize) -> Duration {
        Duration::from_secs_f64(bytes as f64 * 8.0 / PACKED_SHARE / self.bits_per_s)
    }
}

/// A client that fetches and draws a world.
pub struct StreamedVisit<'a> {
    pieces: &'a WorldPieces,
    link: SimulatedLink,
    /// What is here.
    pub fetcher: PieceFetcher,
    /// The last picture.
    pub frame: Frame,
    renderer: Renderer,
    /// Since the client began to connect.
    now: Duration,
    /// When the server has sent all that it was asked for.
    link_free: Duration,
    under_way: VecDeque<(Duration, usize)>,
    /// The bytes that have arrived.
    pub bytes: usize,
    /// Whether the plan of the storey is wanted.
    pub plan: bool,
    /// Whether everything is fetched in the end.
    pub all: bool,
}

/// What a moment of a visit shows.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// The time since the client began to connect.
    pub at: Duration,
    /// Whether there is a picture: all voxels around the eye are there.
    pub is_open: bool,
    /// Whether the picture shows nothing that is coarser than its pixels.
    pub is_sharp: bool,
}

impl<'a> StreamedVisit<'a> {
    /// A visit that begins when the head has arrived.
    ///
    /// # Errors
    /// When the head cannot be read.
    pub fn new(
        pieces: &'a WorldPieces,
        link: SimulatedLink,
        size: (usize, usize),
    ) -> Result<Self, ReadError> {
        let fetcher = PieceFetcher::new(WorldHead::read(&pieces.head)?);
        let now = link.delay * 2 * (GREETING + 1) + link.takes(pieces.head.len());
        Ok(Self {
            pieces,
            link,
            fetcher,
            frame: Frame::new(size.0, size.1),
            renderer: Renderer::default(),
            now,
            link_free: now - link.delay,
            under_way: VecDeque::new(),
            bytes: pieces.head.len(),
            plan: false,
            all: false,
        })
    }

    /// Draws a picture, asks for what it lacks, and lets a frame's time pass.
    ///
    /// # Errors
    /// When a piece cannot be taken in.
    pub fn step(&mut self, camera: &Camera, velocity: Vec3) -> Result<Moment, PieceError> {
        let at = self.now;
        let is_open = self.fetcher.is_open_at(camera.eye);
        let mut shown: Vec<ShownBranch> = Vec::new();
        if is_open {
            self.renderer.draw(self.fetcher.octree().octree(), camera, &mut self.frame);
            shown = shown_branches(&self.frame, camera, self.fetcher.octree(), 1);
        }
        let outlook = Outlook {
            eye: camera.eye,
            velocity,
            focal: camera.focal(self.frame.height()),
            shown: &shown,
            plan: self.plan,
            all: self.all,
        };
        let is_sharp = is_open && self.fetcher.is_sharp(&outlook);
        for number in self.fetcher.next(&outlook, UNDER_WAY) {
            self.ask(number);
        }
        self.now += FRAME;
        while let Some(&(arrives, number)) = self.under_way.front()
            && arrives <= self.now
        {
            self.under_way.pop_front();
            if let Some(piece) = self.pieces.pieces.get(number) {
                self.bytes += piece.len() + PIECE_SPARE;
                self.fetcher.take(number, piece.clone())?;
            }
        }
        Ok(Moment { at, is_open, is_sharp })
    }

    fn ask(&mut self, number: usize) {
        let bytes = self.pieces.pieces.get(number).map_or(0, Vec::len) + PIECE_SPARE;
        self.link_free = self.link_free.max(self.now + self.link.delay) + self.link.takes(bytes);
        self.under_way.push_back((self.link_free + self.link.delay, number));
    }
}
