//! How much more the pixels change along a slow path than the scene does.

use serde::Serialize;
use sightline_renderer::Frame;

use super::channels;

/// The number of samples per pixel of the reference picture, along each axis.
const SAMPLES: usize = 3;

/// How pictures along a slow path change from one frame to the next, in levels (of 255) of a
/// pixel's mean channel.
///
/// Motion changes pixels. In a reference picture every pixel is the mean of many samples, so it
/// changes as smoothly as the scene. Shimmer is the difference between the changes of the two
/// pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Shimmer {
    /// The mean change of a pixel.
    pub change: f64,
    /// The mean change of a pixel in the reference pictures.
    pub smooth: f64,
    /// The mean difference between these two changes, pixel by pixel.
    pub excess: f64,
}

impl Shimmer {
    /// Measures some frames. `draw` draws a frame of the path, by number, at the size of the frame
    /// passed in.
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
    assert!(large.width() == width * SAMPLES, "{SAMPLES} samples per pixel and axis");
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

    /// A grey ramp that moves, with or without noise that differs in every frame.
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
    fn noise_is_shimmer_and_motion_is_not() {
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
