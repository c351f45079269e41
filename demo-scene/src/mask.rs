//! Boolean pictures: distance to the outline, filled holes, overlap.

use std::collections::VecDeque;

use glam::DVec2;
use image::{GrayImage, Luma};

/// A boolean picture.
#[derive(Clone)]
pub(crate) struct Mask {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Row by row.
    pub(crate) on: Vec<bool>,
}

impl Mask {
    pub(crate) fn from_alpha(alpha: &GrayImage) -> Self {
        Self {
            width: alpha.width() as usize,
            height: alpha.height() as usize,
            on: alpha.pixels().map(|p| p.0[0] >= 128).collect(),
        }
    }

    pub(crate) fn to_image(&self) -> GrayImage {
        GrayImage::from_fn(self.width as u32, self.height as u32, |x, y| {
            Luma([if self.on[y as usize * self.width + x as usize] {
                255
            } else {
                0
            }])
        })
    }

    pub(crate) fn position(&self, index: usize) -> DVec2 {
        DVec2::new((index % self.width) as f64, (index / self.width) as f64)
    }

    pub(crate) fn neighbours(&self, index: usize) -> impl Iterator<Item = usize> + use<> {
        let (x, y, width, height) = (
            index % self.width,
            index / self.width,
            self.width,
            self.height,
        );
        [
            (x > 0).then(|| index - 1),
            (x + 1 < width).then(|| index + 1),
            (y > 0).then(|| index - width),
            (y + 1 < height).then(|| index + width),
        ]
        .into_iter()
        .flatten()
    }

    pub(crate) fn iou(&self, other: &Self) -> f64 {
        let (mut both, mut either) = (0_u32, 0_u32);
        for (a, b) in self.on.iter().zip(&other.on) {
            both += u32::from(*a && *b);
            either += u32::from(*a || *b);
        }
        f64::from(both) / f64::from(either.max(1))
    }

    /// Distance in pixels to the nearest pixel of the other kind, positive inside (two chamfer
    /// sweeps: right to a few per cent).
    pub(crate) fn signed_distance(&self) -> Vec<f64> {
        let far = (self.width + self.height) as f64;
        let sweep = |kind: bool| {
            let mut d: Vec<f64> = self
                .on
                .iter()
                .map(|on| if *on == kind { far } else { 0.0 })
                .collect();
            let (w, h) = (self.width as isize, self.height as isize);
            let mut relax = |x: isize, y: isize, steps: [(isize, isize, f64); 4]| {
                let here = (y * w + x) as usize;
                for (dx, dy, cost) in steps {
                    let (nx, ny) = (x + dx, y + dy);
                    if nx >= 0 && ny >= 0 && nx < w && ny < h {
                        d[here] = d[here].min(d[(ny * w + nx) as usize] + cost);
                    }
                }
            };
            let diagonal = core::f64::consts::SQRT_2;
            for y in 0..h {
                for x in 0..w {
                    relax(
                        x,
                        y,
                        [
                            (-1, 0, 1.0),
                            (0, -1, 1.0),
                            (-1, -1, diagonal),
                            (1, -1, diagonal),
                        ],
                    );
                }
            }
            for y in (0..h).rev() {
                for x in (0..w).rev() {
                    relax(
                        x,
                        y,
                        [
                            (1, 0, 1.0),
                            (0, 1, 1.0),
                            (1, 1, diagonal),
                            (-1, 1, diagonal),
                        ],
                    );
                }
            }
            d
        };
        let (inside, outside) = (sweep(true), sweep(false));
        inside.iter().zip(&outside).map(|(i, o)| i - o).collect()
    }
}

/// Turns on everything that cannot be reached from the picture's border.
pub(crate) fn fill_holes(mask: &mut Mask) {
    let (w, h) = (mask.width, mask.height);
    let border =
        (0..mask.on.len()).filter(|i| i % w == 0 || i % w == w - 1 || *i < w || *i >= w * (h - 1));
    let mut queue: VecDeque<usize> = border.filter(|i| !mask.on[*i]).collect();
    let mut outside = vec![false; mask.on.len()];
    for i in &queue {
        outside[*i] = true;
    }
    while let Some(i) = queue.pop_front() {
        for n in mask.neighbours(i) {
            if !outside[n] && !mask.on[n] {
                outside[n] = true;
                queue.push_back(n);
            }
        }
    }
    for (on, outside) in mask.on.iter_mut().zip(outside) {
        *on = !outside;
    }
}

/// Intersection over union of a mask with an alpha matte cut at one half; 0 without a mask.
pub(crate) fn iou(mask: Option<&GrayImage>, alpha: &GrayImage) -> f64 {
    mask.map_or(0.0, |mask| {
        Mask::from_alpha(mask).iou(&Mask::from_alpha(alpha))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc(size: u32, hole: f64) -> GrayImage {
        GrayImage::from_fn(size, size, |x, y| {
            let d = (DVec2::new(f64::from(x), f64::from(y)) - f64::from(size) / 2.0).length();
            Luma([if d < f64::from(size) * 0.3 && d > hole {
                255
            } else {
                0
            }])
        })
    }

    #[test]
    fn signed_distance_of_a_disc() {
        let mask = Mask::from_alpha(&disc(40, -1.0));
        let distance = mask.signed_distance();
        assert!((distance[20 * 40 + 20] - 12.0).abs() < 1.0);
        assert!((distance[20 * 40 + 39] + 7.0).abs() < 1.5);
    }

    #[test]
    fn holes_are_filled() {
        let mut mask = Mask::from_alpha(&disc(40, 5.0));
        fill_holes(&mut mask);
        assert!(mask.iou(&Mask::from_alpha(&disc(40, -1.0))) > 0.999);
    }
}
