//! How large the drawn picture is compared to the window, so that it stays fluent.

/// Keeps a moving mean of the time that a frame takes, and draws at half the size when that is too
/// long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DynamicResolution {
    mean_ms: f32,
    /// Window pixels for each drawn one, in each direction: 1 or 2.
    divisor: usize,
    /// Frames since the last change.
    since: u32,
}

/// Slower than 20 frames a second is too slow.
const SLOW_MS: f32 = 50.0;

/// At half the size: fast enough that four times as many pixels would be drawn in time.
const FAST_MS: f32 = 9.0;

/// A change must prove itself first.
const FRAMES_BETWEEN: u32 = 30;

/// A single slow frame, while something is loaded, counts no more.
const COUNTED_MS_MAX: f32 = 150.0;

/// The weight of one frame in the mean.
const WEIGHT: f32 = 0.1;

impl Default for DynamicResolution {
    fn default() -> Self {
        Self { mean_ms: 20.0, divisor: 1, since: 0 }
    }
}

impl DynamicResolution {
    /// Takes in how long a frame took.
    pub(super) fn drew(&mut self, milliseconds: f32) {
        self.mean_ms += (milliseconds.min(COUNTED_MS_MAX) - self.mean_ms) * WEIGHT;
        self.since = self.since.saturating_add(1);
        let divisor = match self.divisor {
            1 if self.mean_ms > SLOW_MS => 2,
            2 if self.mean_ms < FAST_MS => 1,
            same => same,
        };
        if divisor != self.divisor && self.since >= FRAMES_BETWEEN {
            *self = Self { mean_ms: 20.0, divisor, since: 0 };
        }
    }

    /// Window pixels for each drawn one, in each direction.
    pub(super) fn divisor(&self) -> usize {
        self.divisor
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_frames_get_smaller_and_fast_ones_whole_again() {
        let mut dynamic_resolution = DynamicResolution::default();
        let mut after = |milliseconds: f32, frames: u32| {
            (0..frames).for_each(|_| dynamic_resolution.drew(milliseconds));
            dynamic_resolution.divisor()
        };
        assert_eq!(after(30.0, 300), 1);
        assert_eq!(after(500.0, 1), 1, "one slow frame is nothing");
        assert_eq!(after(90.0, 60), 2);
        assert_eq!(after(22.0, 300), 2, "it would be too slow at full size");
        assert_eq!(after(5.0, 60), 1);
    }
}
