//! How many pixels are drawn, so that pictures follow each other smoothly.

/// A picture takes this long at most, in milliseconds, until it is on the page: 30 a second, with
/// some time left for everything else.
const WANTED_MS: f32 = 28.0;
/// Pictures that take less than this share of it may be larger.
const EASY: f32 = 0.7;
/// A picture of somebody who stands still may take this long, in milliseconds.
const RESTING_MS: f32 = 250.0;
/// The greatest number of pixels.
const PIXELS_MAX: f32 = 2.1e6;
/// The smallest share of the page's pixels along each axis.
const SHARE_MIN: f32 = 0.2;
/// Shares differ by multiples of this, so that sizes seldom change.
const SHARE_STEP: f32 = 0.05;
/// The least number of pictures between two changes.
const PICTURES_BETWEEN: u32 = 8;
/// The weight of a picture in the moving average.
const WEIGHT: f32 = 0.2;
/// A slow picture counts as at most this much, in milliseconds: one alone changes little.
const COUNTED_MS_MAX: f32 = 90.0;

/// Chooses the size of pictures by how long they took.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Resolution {
    /// The share of the page's pixels along each axis while one moves.
    share: f32,
    mean_ms: f32,
    /// Pictures since the last change.
    since: u32,
    /// Whether the last size was for somebody who stands still.
    rests: bool,
}

impl Default for Resolution {
    fn default() -> Self {
        Self { share: 0.6, mean_ms: WANTED_MS * 0.85, since: 0, rests: false }
    }
}

impl Resolution {
    /// The size for a canvas of a size.
    pub(crate) fn size(&mut self, [columns, rows]: [usize; 2], rests: bool) -> [usize; 2] {
        self.rests = rests;
        let pixels = (columns * rows).max(1) as f32;
        let share_max = (PIXELS_MAX / pixels).sqrt().min(1.0);
        let share = if rests {
            // The time grows with the pixels.
            self.share * (RESTING_MS / self.mean_ms.max(1.0)).sqrt().max(1.0)
        } else {
            self.share
        };
        let share = share.min(share_max);
        [columns, rows].map(|side| ((side as f32 * share).round() as usize).max(1))
    }

    /// Takes in how long a picture took that was drawn anew.
    pub(crate) fn drew(&mut self, milliseconds: f32) {
        if self.rests || !milliseconds.is_finite() {
            return;
        }
        self.mean_ms += (milliseconds.min(COUNTED_MS_MAX) - self.mean_ms) * WEIGHT;
        self.since = self.since.saturating_add(1);
        let is_slow = self.mean_ms > WANTED_MS;
        let is_easy = self.mean_ms < WANTED_MS * EASY && self.share < 1.0;
        if self.since < PICTURES_BETWEEN || !(is_slow || is_easy) {
            return;
        }
        let fits = self.share * (WANTED_MS * 0.85 / self.mean_ms).sqrt();
        // Larger by one step at a time, smaller at once.
        let fits = fits.clamp(SHARE_MIN, self.share + SHARE_STEP).min(1.0);
        let share = ((fits / SHARE_STEP).round() * SHARE_STEP).clamp(SHARE_MIN, 1.0);
        if share != self.share {
            let scaled = self.mean_ms * (share / self.share).powi(2);
            *self = Self { share, mean_ms: scaled, since: 0, rests: false };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The size after some seconds on a machine that takes `ns` for each pixel.
    fn settled(ns: f32) -> [usize; 2] {
        let (mut resolution, page) = (Resolution::default(), [1280, 720]);
        for _ in 0..400 {
            let [columns, rows] = resolution.size(page, false);
            resolution.drew((columns * rows) as f32 * ns * 1e-6);
        }
        resolution.size(page, false)
    }

    #[test]
    fn pictures_take_no_longer_than_wanted_and_not_much_less() {
        for ns in [20.0, 60.0, 150.0, 400.0] {
            let [columns, rows] = settled(ns);
            let milliseconds = (columns * rows) as f32 * ns * 1e-6;
            let is_full = [columns, rows] == [1280, 720];
            assert!(milliseconds <= WANTED_MS, "{columns} × {rows} take {milliseconds} ms");
            assert!(is_full || milliseconds > WANTED_MS * 0.55, "{columns} × {rows}");
        }
        assert_eq!(settled(20.0), [1280, 720]);
    }

    #[test]
    fn who_stands_still_sees_more_but_waits_a_quarter_of_a_second_at_most() {
        let mut resolution = Resolution::default();
        for _ in 0..100 {
            let [columns, rows] = resolution.size([1280, 720], false);
            resolution.drew((columns * rows) as f32 * 200e-6);
        }
        let (moving, resting) =
            (resolution.size([1280, 720], false), resolution.size([1280, 720], true));
        assert!(resting[0] > moving[0] && resting[0] <= 1280);
        assert!((resting[0] * resting[1]) as f32 * 200e-6 < 320.0);
        resolution.drew(300.0);
        assert_eq!(resolution.size([1280, 720], false), moving, "it does not count");
    }
}
