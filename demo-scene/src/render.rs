//! One view: photo, coverage and the two background plates from the same camera rays.

use glam::DVec2;
use image::{GrayImage, Luma, Rgb, RgbImage};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::film::{Sample, ToneCurve, gather, jitter, quantise};
use crate::lighting::{Visibility, radiance, vignette, visibility};
use crate::noise::Rng;
use crate::stage::{Hit, Seen, Stage, TABLE_CENTRE, TARGET};

/// The pictures of one view.
pub(crate) struct Pictures {
    pub(crate) photo: RgbImage,
    pub(crate) alpha: GrayImage,
    pub(crate) background: RgbImage,
    pub(crate) background_shadow: RgbImage,
}

/// Shadow and occlusion vary slowly: nearby samples of one pixel on one surface share them.
#[derive(Default)]
struct SharedLight(Option<(Hit, Visibility)>);

impl SharedLight {
    fn at(&mut self, stage: &Stage, hit: &Hit) -> Visibility {
        if let Some((known, light)) = &self.0
            && known.prop == hit.prop
            && known.normal.dot(hit.normal) > 0.97
            && (known.point - hit.point).length() < 0.006 * hit.t
        {
            return *light;
        }
        let light = visibility(stage, hit);
        self.0 = Some((*hit, light));
        light
    }
}

/// Renders one view. `stream` separates the random numbers of different views.
pub(crate) fn render(
    stage: &Stage,
    camera: &Camera,
    per_pixel: usize,
    seed: u64,
    stream: u64,
) -> Pictures {
    let size = (camera.width as usize, camera.height as usize);
    let mut samples = vec![Sample::default(); size.0 * size.1 * per_pixel];
    samples
        .par_chunks_mut(size.0 * per_pixel)
        .enumerate()
        .for_each(|(y, row)| {
            let mut rng = Rng::new(seed, stream << 20 | y as u64);
            for (x, pixel) in row.chunks_mut(per_pixel).enumerate() {
                expose(stage, camera, (x, y), &mut rng, pixel);
            }
        });

    let curve = ToneCurve::new();
    let rows: Vec<Vec<([[u8; 3]; 3], u8)>> = (0..size.1)
        .into_par_iter()
        .map(|y| {
            let mut rng = Rng::new(seed ^ 0x5e50, stream << 20 | y as u64);
            let develop = |x| {
                let (layers, coverage) = gather(&samples, per_pixel, size, (x, y));
                let mut bytes = [[0; 3]; 3];
                for (layer, (out, values)) in bytes.iter_mut().zip(&layers).enumerate() {
                    for (out, value) in out.iter_mut().zip(values) {
                        *out = quantise(curve.apply(*value), (layer == 0).then_some(&mut rng));
                    }
                }
                (bytes, quantise(coverage, None))
            };
            (0..size.0).map(develop).collect()
        })
        .collect();
    let layer = |k: usize| {
        RgbImage::from_fn(camera.width, camera.height, |x, y| {
            Rgb(rows[y as usize][x as usize].0[k])
        })
    };
    Pictures {
        photo: layer(0),
        background_shadow: layer(1),
        background: layer(2),
        alpha: GrayImage::from_fn(camera.width, camera.height, |x, y| {
            Luma([rows[y as usize][x as usize].1])
        }),
    }
}

/// Traces and shades the samples of one pixel.
fn expose(
    stage: &Stage,
    camera: &Camera,
    (x, y): (usize, usize),
    rng: &mut Rng,
    samples: &mut [Sample],
) {
    let eye = camera.centre() - TABLE_CENTRE;
    let shift = DVec2::new(rng.unit(), rng.unit());
    let count = samples.len();
    let (mut front, mut behind) = (SharedLight::default(), SharedLight::default());
    let half_size = 0.5 * DVec2::new(f64::from(camera.width), f64::from(camera.height));
    for (index, sample) in samples.iter_mut().enumerate() {
        let inside = jitter(index, count, shift);
        let pixel = DVec2::new(x as f64, y as f64) + inside;
        let along = camera.ray(pixel);
        let hit = stage.trace(eye, along, Seen::Everything);
        let light = front.at(stage, &hit);
        let material = stage.material(&hit);
        let seen = radiance(&hit, &material, along, &light.with_target);
        let on_target = hit.prop == Some(TARGET);
        let (shadowed, bare) = if on_target {
            let hit = stage.trace(eye, along, Seen::Background);
            let light = behind.at(stage, &hit);
            let material = stage.material(&hit);
            (
                radiance(&hit, &material, along, &light.with_target),
                radiance(&hit, &material, along, &light.without_target),
            )
        } else if light.with_target == light.without_target {
            (seen, seen)
        } else {
            (
                seen,
                radiance(&hit, &material, along, &light.without_target),
            )
        };
        let lens = vignette((pixel - half_size) / half_size.length());
        *sample = Sample {
            layers: [seen, shadowed, bare].map(|c| (c * lens).as_vec3().to_array()),
            target: f32::from(u8::from(on_target)),
            x: inside.x as f32,
            y: inside.y as f32,
        };
    }
}
