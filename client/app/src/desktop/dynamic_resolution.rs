//! Draws fewer pixels than the window has when frames take too long.

/// Keeps a moving average of the time per frame. Above a limit, frames are drawn at half the
/// window's width and height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DynamicResolution {
    mean_ms: f32,
    /// Window pixels per drawn pixel, along each axis: 1 or 2.
    divisor: usize,
    /// Frames since the last change.
    since: u32,
}

/// Above this time per frame, the resolution is halved: below 20 frames per second.
const SLOW_MS: f32 = 50.0;

/// Below this time per frame at half resolution, four times as many pixels take less than
/// [`SLOW_MS`].
const FAST_MS: f32 = 9.0;

/// The least number of frames between two changes.
const FRAMES_BETWEEN: u32 = 30;

/// A slow frame counts as at most this much: one alone, while something is loaded, changes nothing.
const COUNTED_MS_MAX: f32 = 150.0;

/// The weight of a frame in the moving average.
const WEIGHT: f32 = 0.1;

impl Default for DynamicResolution {
    fn default() -> Self {
        Self { mean_ms: 20.0, divisor: 1, since: 0 }
    }
}

impl DynamicResolution {
    /// Takes in the time that a frame took.
    pub(super) fn drew(&mut self, milliseconds: f32) {
        self.mean_ms += (milliseconds.min(COUNTED_MS_MAX) - self.mean_ms) * WEIGHT;
        self.since = self.since.saturating_add(1);
        debug_assert!(self.divisor == 1 || self.divisor == 2, "full or half resolution");
        let divisor = match self.divisor {
            1 if self.mean_ms > SLOW_MS => 2,
            2 if self.mean_ms < FAST_MS => 1,
            same => same,
        };
        if divisor != self.divisor && self.since >= FRAMES_BETWEEN {
            *self = Self { mean_ms: 20.0, divisor, since: 0 };
        }
    }

    /// Window pixels per drawn pixel, along each axis.
    pub(super) fn divisor(&self) -> usize {
        self.divisor
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_frames_halve_the_resolution_and_fast_ones_restore_it() {
        let mut dynamic_resolution = DynamicResolution::default();
        let mut after = |milliseconds: f32, frames: u32| {
            (0..frames).for_each(|_| dynamic_resolution.drew(milliseconds));
            dynamic_resolution.divisor()
        };
        assert_eq!(after(30.0, 300), 1);
        assert_eq!(after(500.0, 1), 1, "one slow frame changes nothing");
        assert_eq!(after(90.0, 60), 2);
        assert_eq!(after(22.0, 300), 2, "it would be too slow at full size");
        assert_eq!(after(5.0, 60), 1);
    }
}
