//! How much more a picture changes along a slow path than what it shows.

use serde::Serialize;

use super::channels;
use sightline_renderer::Frame;

/// Every pixel of the picture that is compared with is the mean of so many by so many.
const SAMPLES: usize = 3;

/// How pictures along a slow path change from one frame to the next, in levels (of 255) of a pixel's mean channel.
///
/// What moves makes pixels change. A picture in which every pixel is the mean of many changes as smoothly as what it shows;
/// how far the changes are from those is shimmer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Shimmer {
    /// The mean change of a pixel.
    pub change: f64,
    /// The same in pictures of many samples a pixel.
    pub smooth: f64,
    /// The mean difference of these two changes, pixel by pixel.
    pub excess: f64,
}

impl Shimmer {
    /// Of so many frames, each of which `draw` draws at the size of the frame it is given.
    pub fn of(
        frames: usize,
        size: (usize, usize),
        mut draw: impl FnMut(usize, &mut Frame),
    ) -> Self {
        let (width, height) = size;
        let mut plain = [Frame::new(width, height), Frame::new(width, height)];
        let mut large = Frame::new(width * SAMPLES, height * SAMPLES);
        let mut smooth = [vec![[0.0; 3]; width * height], vec![[0.0; 3]; width * height]];
        let mut sum = Self::default();
        for i in 0..frames {
            let (now, before) = (i % 2, 1 - i % 2);
            draw(i, &mut plain[now]);
            draw(i, &mut large);
            smooth[now] = means(&large, width);
            if i > 0 {
                sum.add(&plain[before], &plain[now], &smooth[before], &smooth[now]);
            }
        }
        let parts = (frames.saturating_sub(1) * width * height * 3).max(1) as f64;
        Self { change: sum.change / parts, smooth: sum.smooth / parts, excess: sum.excess / parts }
    }

    fn add(&mut self, a: &Frame, b: &Frame, smooth_a: &[[f32; 3]], smooth_b: &[[f32; 3]]) {
        let plain = a.colour.iter().zip(&b.colour);
        for ((&a, &b), (smooth_a, smooth_b)) in plain.zip(smooth_a.iter().zip(smooth_b)) {
            self.change += channels(a, b).iter().map(|&level| f64::from(level)).sum::<f64>();
            let (a, b) = (levels(a), levels(b));
            for k in 0..3 {
                let smooth = smooth_b[k] - smooth_a[k];
                self.smooth += f64::from(smooth.abs());
                self.excess += f64::from((b[k] - a[k] - smooth).abs());
            }
        }
    }
}

fn levels(pixel: u32) -> [f32; 3] {
    [16, 8, 0].map(|shift| f32::from((pixel >> shift) as u8))
}

/// The mean of each square of samples.
fn means(large: &Frame, width: usize) -> Vec<[f32; 3]> {
    let mut sums = vec![[0.0f32; 3]; large.colour.len() / SAMPLES / SAMPLES];
    for (i, &pixel) in large.colour.iter().enumerate() {
        let (x, y) = (i % (width * SAMPLES) / SAMPLES, i / (width * SAMPLES) / SAMPLES);
        let sum = &mut sums[y * width + x];
        let share = levels(pixel).map(|level| level / (SAMPLES * SAMPLES) as f32);
        *sum = std::array::from_fn(|k| sum[k] + share[k]);
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grey that ramps up to the right and moves, with or without noise that is another in every frame.
    fn shimmer(noise: u32) -> Shimmer {
        Shimmer::of(5, (32, 8), |frame, picture| {
            let (width, scale) = (picture.width(), picture.width() as u32 / 32);
            for (i, pixel) in picture.colour.iter_mut().enumerate() {
                let x = (i % width) as u32;
                let speck = (i as u32 + frame as u32 * 7).wrapping_mul(0x9e37_79b9) >> 20;
                let grey = x * 4 / scale + 8 * frame as u32 + speck % (noise + 1);
                *pixel = grey.min(255) * 0x0001_0101;
            }
        })
    }

    #[test]
    fn motion_is_no_shimmer_and_noise_is() {
        let still = shimmer(0);
        assert!(
            (still.change - 8.0).abs() < 0.01 && (still.smooth - 8.0).abs() < 0.01,
            "{still:?}"
        );
        assert!(still.excess < 0.01, "{still:?}");
        let noisy = shimmer(40);
        assert!(noisy.excess > 5.0, "{noisy:?}");
    }
}
