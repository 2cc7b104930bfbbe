//! The stages of a compilation: progress, cancellation and times.

use std::{
    ops::ControlFlow,
    sync::atomic::{AtomicBool, Ordering::Relaxed},
    time::Instant,
};

use cpu_time::ProcessTime;
use serde::Serialize;

use crate::error::CompileError;

/// A stage of a compilation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Stage {
    /// Triangles merge to polygons, and what is not axial is carved out.
    Carving,
    /// Space is split along the occluders, and portals are found.
    Cells,
    /// Sight lines propagate through the portals.
    Pvs,
    /// Surfaces are lit, when the model brings no light of its own.
    Light,
    /// Surfaces become voxels.
    Voxels,
    /// Places where visitors can begin are found.
    Spawns,
}

impl Stage {
    /// The name that people read.
    pub fn name(self) -> &'static str {
        match self {
            Self::Carving => "carving",
            Self::Cells => "cells and portals",
            Self::Pvs => "sight lines",
            Self::Light => "light",
            Self::Voxels => "voxels",
            Self::Spawns => "spawn points",
        }
    }
}

/// Passes progress on to the caller, and remembers that the caller broke the compilation.
pub(crate) struct ProgressRelay<'a> {
    progress: &'a (dyn Fn(Stage, f32) -> ControlFlow<()> + Sync),
    is_cancelled: AtomicBool,
}

impl<'a> ProgressRelay<'a> {
    /// A relay to a callback.
    pub(crate) fn new(progress: &'a (dyn Fn(Stage, f32) -> ControlFlow<()> + Sync)) -> Self {
        Self { progress, is_cancelled: AtomicBool::new(false) }
    }

    /// Reports the share of a stage that is done, from any thread. Once broken, it stays broken.
    pub(crate) fn report(&self, stage: Stage, share: f32) -> ControlFlow<()> {
        debug_assert!((0.0..=1.0).contains(&share), "{stage:?} is done to {share}");
        if self.is_cancelled.load(Relaxed) {
            return ControlFlow::Break(());
        }
        (self.progress)(stage, share).map_break(|()| self.is_cancelled.store(true, Relaxed))
    }

    /// Reports that a stage begins. A break becomes an error.
    pub(crate) fn begin(&self, stage: Stage) -> Result<(), CompileError> {
        match self.report(stage, 0.0) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(CompileError::Cancelled),
        }
    }
}

/// Measures wall-clock and processor time of each stage.
#[derive(Default)]
pub(crate) struct StageTimer {
    pub(crate) seconds: Vec<(Stage, f64)>,
    pub(crate) cpu_seconds: Vec<(Stage, f64)>,
}

impl StageTimer {
    /// Runs a stage, or a part of the last one, and notes its times.
    pub(crate) fn time<T>(&mut self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let (start, cpu_start) = (Instant::now(), ProcessTime::try_now());
        let done = work();
        add(&mut self.seconds, stage, start.elapsed().as_secs_f64());
        if let (Ok(start), Ok(end)) = (cpu_start, ProcessTime::try_now()) {
            add(&mut self.cpu_seconds, stage, end.duration_since(start).as_secs_f64());
        }
        done
    }
}

fn add(times: &mut Vec<(Stage, f64)>, stage: Stage, seconds: f64) {
    match times.last_mut() {
        Some((last, before)) if *last == stage => *before += seconds,
        _ => times.push((stage, seconds)),
    }
}
