//! Looking along rays in rounds, front to back, as far as light goes.
//!
//! Half of a ray's samples and more lie behind its first surface. So a round asks the fields about
//! the next few samples of every ray that still has light, and the next round only those rays that
//! have some left. What is reached comes out with the same bits as if all had been asked at once.

use glam::Vec3;
use neus_render::composite::{
    CompositeConfig, Light, Packing, SampleVisibility, Visibility, background_column,
    object_column, visibility_from,
};
use rayon::prelude::*;
use scene_decomp::colour_field::density_of;
use scene_decomp::{FrozenSurface, Geometry};

use super::batch::{FieldSamples, MarchedBatch};
use super::visible::{LEAST_TRANSMITTANCE, Look};
use crate::config::Transparency;

/// Samples of a ray in the first round; twice as many in each further one.
const FIRST_ROUND: usize = 8;
/// Points that one task copies.
const CHUNK: usize = 1024;

/// What a look needs to know of the fields besides themselves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rules {
    /// Of object and background.
    pub(super) transparency: [Transparency; 2],
    /// The matte value that samples of the object count with.
    pub(super) matte: f32,
    pub(super) sharpness: [f32; 2],
    pub(super) compositing: CompositeConfig,
}

/// Looks at `marched` until no ray has light left: through both fields, or through the background
/// by itself where that is asked for `alone`.
pub(super) fn look(
    object: &FrozenSurface,
    background: &FrozenSurface,
    marched: &MarchedBatch,
    rules: Rules,
    alone: impl Fn(usize) -> bool,
) -> Look {
    let mut out = Look {
        object: blank(object, marched.object.len()),
        background: blank(background, marched.background.len()),
        visibility: SampleVisibility {
            object: vec![Visibility::default(); marched.object.len()],
            background: vec![Visibility::default(); marched.background.len()],
        },
    };
    let mut rays = all_rays(&marched.packing);
    let mut most = FIRST_ROUND;
    while !rays.is_empty() {
        let mut round = Round::new(&marched.packing, &mut rays, most);
        let object_geometry = ask(object, &marched.object, &round.object, &mut out.object);
        let background_geometry = ask(
            background,
            &marched.background,
            &round.background,
            &mut out.background,
        );
        let slope = |geometry: &Geometry, i: usize, at: &FieldSamples, row: u32| {
            let direction = Vec3::from_slice(&at.directions[3 * row as usize..]);
            geometry.normal(i).dot(direction)
        };
        let [of_object, of_background] = rules.transparency;
        let opaque_by = |transparency, geometry: &Geometry, i, at: &FieldSamples, row| {
            let sdf = geometry.sdf(i);
            match transparency {
                Transparency::Sdf => (sdf, slope(geometry, i, at, row)),
                Transparency::Density => (density_of(sdf), 0.0),
            }
        };
        let object_values = rows::<{ object_column::COUNT }>(&round.object, |i, row, value| {
            (value[object_column::SDF], value[object_column::SLOPE]) =
                opaque_by(of_object, &object_geometry, i, &marched.object, row);
            value[object_column::MATTE] = rules.matte;
        });
        let background_values =
            rows::<{ background_column::COUNT }>(&round.background, |i, row, value| {
                let at = &marched.background;
                (
                    value[background_column::SDF],
                    value[background_column::SLOPE],
                ) = opaque_by(of_background, &background_geometry, i, at, row);
            });
        let seen = visibility_from(
            &object_values,
            &background_values,
            rules.sharpness,
            &round.packing,
            rules.compositing,
            &mut round.light,
        );
        for (rows, seen, all) in [
            (&round.object, seen.object, &mut out.visibility.object),
            (
                &round.background,
                seen.background,
                &mut out.visibility.background,
            ),
        ] {
            for (&row, seen) in rows.iter().zip(seen) {
                all[row as usize] = seen;
            }
        }
        for (ray, light) in rays.iter_mut().zip(&round.light) {
            ray.light = *light;
        }
        rays.retain(|ray| {
            let left = if alone(ray.number) {
                ray.light.background
            } else {
                ray.light.joint
            };
            left > LEAST_TRANSMITTANCE && !ray.is_over()
        });
        most *= 2;
    }
    out
}

fn blank(field: &FrozenSurface, points: usize) -> Geometry {
    let columns = field.columns();
    Geometry {
        values: vec![0.0; points * columns],
        columns,
    }
}

/// Asks a field about the samples with these numbers; their rows are also copied into `all`.
fn ask(field: &FrozenSurface, at: &FieldSamples, chosen: &[u32], all: &mut Geometry) -> Geometry {
    let mut points = vec![0.0; 3 * chosen.len()];
    points
        .par_chunks_mut(3 * CHUNK)
        .zip(chosen.par_chunks(CHUNK))
        .for_each(|(points, rows)| {
            for (point, &row) in points.chunks_exact_mut(3).zip(rows) {
                let start = 3 * row as usize;
                point.copy_from_slice(&at.points[start..start + 3]);
            }
        });
    let found = field.geometry_of(points);
    let columns = all.columns;
    for (values, &row) in found.values.chunks_exact(columns).zip(chosen) {
        let start = row as usize * columns;
        all.values[start..start + columns].copy_from_slice(values);
    }
    found
}

/// One row of `COLUMNS` values for each sample, zero unless `fill(i, number, row)` sets it.
fn rows<const COLUMNS: usize>(
    chosen: &[u32],
    fill: impl Fn(usize, u32, &mut [f32]) + Sync,
) -> Vec<f32> {
    let mut values = vec![0.0; chosen.len() * COLUMNS];
    values
        .par_chunks_mut(COLUMNS)
        .zip(chosen)
        .with_min_len(CHUNK)
        .enumerate()
        .for_each(|(i, (row, &number))| fill(i, number, row));
    values
}

/// A ray that still has light.
#[derive(Clone, Copy, Debug)]
struct ActiveRay {
    number: usize,
    light: Light,
    /// The next rows, and the ends of the ray's.
    object: u32,
    object_end: u32,
    background: u32,
    background_end: u32,
}

impl ActiveRay {
    fn is_over(&self) -> bool {
        self.object == self.object_end && self.background == self.background_end
    }
}

fn all_rays(packing: &Packing) -> Vec<ActiveRay> {
    let (object, background) = (packing.object_offsets(), packing.background_offsets());
    (0..packing.ray_count())
        .map(|number| ActiveRay {
            number,
            light: Light::ALL,
            object: object[number],
            object_end: object[number + 1],
            background: background[number],
            background_end: background[number + 1],
        })
        .filter(|ray| !ray.is_over())
        .collect()
}

/// The next stretch of every active ray.
struct Round {
    packing: Packing,
    light: Vec<Light>,
    /// Rows of the whole batch.
    object: Vec<u32>,
    background: Vec<u32>,
}

impl Round {
    /// Takes up to `most` intervals of each of `rays`, which advance.
    fn new(all: &Packing, rays: &mut [ActiveRay], most: usize) -> Self {
        let mut offsets = Vec::with_capacity(rays.len() + 1);
        offsets.push(0);
        let (mut object, mut background, mut dt) = (Vec::new(), Vec::new(), Vec::new());
        let (mut object_intervals, mut background_intervals) = (Vec::new(), Vec::new());
        for ray in rays.iter_mut() {
            for _ in 0..most {
                let next = |row: u32, end: u32, of: &[u32]| {
                    if row < end {
                        of[row as usize]
                    } else {
                        u32::MAX
                    }
                };
                let object_next = next(ray.object, ray.object_end, all.object());
                let background_next = next(ray.background, ray.background_end, all.background());
                let interval = object_next.min(background_next);
                if interval == u32::MAX {
                    break;
                }
                let number = dt.len() as u32;
                dt.push(all.dt()[interval as usize]);
                if object_next == interval {
                    object.push(ray.object);
                    object_intervals.push(number);
                    ray.object += 1;
                }
                if background_next == interval {
                    background.push(ray.background);
                    background_intervals.push(number);
                    ray.background += 1;
                }
            }
            offsets.push(dt.len() as u32);
        }
        let light = rays.iter().map(|ray| ray.light).collect();
        // Opacities depend on lengths, not on distances.
        let t = vec![0.0; dt.len()];
        Self {
            packing: Packing::new(offsets, t, dt, object_intervals, background_intervals),
            light,
            object,
            background,
        }
    }
}
