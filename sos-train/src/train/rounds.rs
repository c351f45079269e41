//! Looking along rays in rounds, front to back, as far as light goes.
//!
//! Half of a ray's samples and more lie behind its first surface. So a round makes the next few
//! samples of every ray that still has light and asks the fields about them, and the next round only
//! those rays that have some left. What is reached comes out with the same bits as if all had been
//! asked at once.

use glam::Vec3;
use neus_render::composite::{
    CompositeConfig, Light, Packing, SampleVisibility, background_column, object_column,
    visibility_from,
};
use scene_decomp::colour_field::density_of;
use scene_decomp::sdf_field::Tape;
use scene_decomp::{FrozenSurface, Geometry};

use super::batch::{FieldSamples, MarchedBatch, MarchedRays, SampleLists};
use super::order::{by_ray, numbers, select};
use super::visible::{Alone, LEAST_TRANSMITTANCE, Look};
use crate::config::Transparency;

/// Samples of a ray in the first round; twice as many in each further one.
const FIRST_ROUND: usize = 8;

/// What a look needs to know of the fields besides themselves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rules {
    /// Of object and background.
    pub(super) transparency: [Transparency; 2],
    /// Whether light is taken to go on through the object, whose head nobody asks: all of its samples are looked at
    /// then, though they weigh what they would if the head said 1.
    pub(super) through_object: bool,
    pub(super) sharpness: [f32; 2],
    pub(super) compositing: CompositeConfig,
    /// Whether what the fields say is written down, for backward.
    pub(super) taped: [bool; 2],
}

/// Looks along `marched` until no ray has light left: through both fields, or through one by itself
/// where that is asked for `alone`. Returned are the samples that were made for it.
pub(super) fn look(
    object: &FrozenSurface,
    background: &FrozenSurface,
    marched: MarchedRays<'_>,
    rules: Rules,
    alone: impl Fn(usize) -> Alone,
) -> (MarchedBatch, Look) {
    let columns = [object.columns(), background.columns()];
    let mut reached = Reached::new(marched, columns);
    let mut weighed = rules
        .through_object
        .then(|| vec![Light::ALL; marched.rays.len()]);
    // What the object takes of the light that decides how far a ray is followed.
    let matte = if rules.through_object { 0.0 } else { 1.0 };
    let tapes = rules.taped.map(|taped| taped.then(Tape::default));
    let mut rays = all_rays(marched);
    let mut most = FIRST_ROUND;
    while !rays.is_empty() {
        let mut round = reached.advance(&mut rays, most);
        let at = &reached.samples;
        let object_geometry = ask(object, &at.object, round.object, &tapes[0]);
        let background_geometry = ask(background, &at.background, round.background, &tapes[1]);
        let [of_object, of_background] = rules.transparency;
        let mut object_values = rows::<{ object_column::COUNT }>(
            &object_geometry,
            of_object,
            &reached.samples.object.directions[3 * round.object..],
            |value| value[object_column::MATTE] = matte,
        );
        let background_values = rows::<{ background_column::COUNT }>(
            &background_geometry,
            of_background,
            &reached.samples.background.directions[3 * round.background..],
            |_| {},
        );
        let visibility = |object: &[f32], light: &mut [Light]| {
            visibility_from(
                object,
                &background_values,
                rules.sharpness,
                &round.packing,
                rules.compositing,
                light,
            )
        };
        let mut seen = visibility(&object_values, &mut round.light);
        if let Some(weighed) = &mut weighed {
            let values = object_values.as_chunks_mut::<{ object_column::COUNT }>().0;
            let solid = |value: &mut [f32; object_column::COUNT]| value[object_column::MATTE] = 1.0;
            values.iter_mut().for_each(solid);
            let mut light: Vec<Light> = rays.iter().map(|ray| weighed[ray.number]).collect();
            let reach = std::mem::replace(&mut seen, visibility(&object_values, &mut light));
            for (ray, light) in rays.iter().zip(light) {
                weighed[ray.number] = light;
            }
            let reach = reach.object.iter().chain(&reach.background);
            for (seen, reach) in (seen.object.iter_mut().chain(&mut seen.background)).zip(reach) {
                seen.transmittance = reach.transmittance;
            }
        }
        reached.object.values.extend(object_geometry.values);
        reached.background.values.extend(background_geometry.values);
        reached.visibility.object.extend(seen.object);
        reached.visibility.background.extend(seen.background);
        for (ray, light) in rays.iter_mut().zip(&round.light) {
            ray.light = *light;
        }
        rays.retain(|ray| {
            let Alone { object, background } = alone(ray.number);
            let mut left = ray.light.joint;
            if object {
                left = left.max(ray.light.object);
            }
            if background {
                left = left.max(ray.light.background);
            }
            left > LEAST_TRANSMITTANCE && ray.next < ray.end
        });
        most *= 2;
    }
    let [object, background] = tapes.map(|tape| tape.unwrap_or_default().finish());
    reached.samples.object.taped = object;
    reached.samples.background.taped = background;
    reached.in_order(rules.through_object)
}

/// Asks a field about the samples from number `first` on, for the record where there is a tape.
fn ask(field: &FrozenSurface, at: &FieldSamples, first: usize, tape: &Option<Tape>) -> Geometry {
    let points = at.points[3 * first..].to_vec();
    match tape {
        Some(tape) => field.geometry_taped(points, tape),
        None => field.geometry_of(points),
    }
}

/// One row of `COLUMNS` values for each point of `geometry`: how opaque it is, seen along `directions`
/// `[n, 3]`, and what `fill` adds.
fn rows<const COLUMNS: usize>(
    geometry: &Geometry,
    transparency: Transparency,
    directions: &[f32],
    fill: impl Fn(&mut [f32; COLUMNS]),
) -> Vec<f32> {
    const { assert!(object_column::SDF == background_column::SDF) };
    const { assert!(object_column::SLOPE == background_column::SLOPE) };
    let mut values = vec![0.0; directions.len() / 3 * COLUMNS];
    let rows = values.as_chunks_mut::<COLUMNS>().0.iter_mut();
    for (i, (row, direction)) in rows.zip(directions.chunks_exact(3)).enumerate() {
        let sdf = geometry.sdf(i);
        match transparency {
            Transparency::Sdf => {
                row[object_column::SDF] = sdf;
                row[object_column::SLOPE] = geometry.normal(i).dot(Vec3::from_slice(direction));
            }
            Transparency::Density => row[object_column::SDF] = density_of(sdf),
        }
        fill(row);
    }
    values
}

/// A ray that still has light.
#[derive(Clone, Copy, Debug)]
struct ActiveRay {
    number: usize,
    light: Light,
    /// The next interval, and the end of the ray's.
    next: u32,
    end: u32,
}

fn all_rays(marched: MarchedRays<'_>) -> Vec<ActiveRay> {
    (0..marched.rays.len())
        .map(|number| {
            let range = marched.range(number);
            ActiveRay {
                number,
                light: Light::ALL,
                next: range.start,
                end: range.end,
            }
        })
        .filter(|ray| ray.next < ray.end)
        .collect()
}

/// The next stretch of every active ray.
struct Round {
    packing: Packing,
    light: Vec<Light>,
    /// Number of its first sample.
    object: usize,
    background: usize,
}

/// What was asked about so far, round by round.
struct Reached<'a> {
    marched: MarchedRays<'a>,
    /// The samples' intervals are numbers in the lists below.
    samples: SampleLists,
    object: Geometry,
    background: Geometry,
    visibility: SampleVisibility,
    /// Of each interval that has a sample: its ray, its number among all marched, and its length.
    ray: Vec<u32>,
    interval: Vec<u32>,
    dt: Vec<f32>,
}

impl<'a> Reached<'a> {
    fn new(marched: MarchedRays<'a>, columns: [usize; 2]) -> Self {
        let blank = |columns| Geometry {
            values: Vec::new(),
            columns,
        };
        let [object, background] = columns.map(blank);
        let room = 2 * FIRST_ROUND * marched.rays.len();
        Self {
            marched,
            samples: SampleLists::with_capacity(room, room),
            object,
            background,
            visibility: SampleVisibility::default(),
            ray: Vec::with_capacity(room),
            interval: Vec::with_capacity(room),
            dt: Vec::with_capacity(room),
        }
    }

    /// Makes the samples of up to `most` intervals of each of `rays`, which advance.
    fn advance(&mut self, rays: &mut [ActiveRay], most: usize) -> Round {
        let first = self.dt.len();
        let samples = &mut self.samples;
        let (object, background) = (samples.object.len(), samples.background.len());
        let mut offsets = Vec::with_capacity(rays.len() + 1);
        offsets.push(0);
        for ray in rays.iter_mut() {
            let begin = self.dt.len();
            while ray.next < ray.end && self.dt.len() < begin + most {
                let interval = ray.next;
                ray.next += 1;
                if let Some(length) = self.marched.add(ray.number, interval, samples) {
                    self.ray.push(ray.number as u32);
                    self.interval.push(interval);
                    self.dt.push(length);
                }
            }
            offsets.push((self.dt.len() - first) as u32);
        }
        let dt = self.dt[first..].to_vec();
        let numbers = |of: &[u32]| numbers(&self.interval[first..], of);
        Round {
            // Opacities depend on lengths, not on distances.
            packing: Packing::new(
                offsets,
                vec![0.0; dt.len()],
                dt,
                numbers(&samples.object_intervals[object..]),
                numbers(&samples.background_intervals[background..]),
            ),
            light: rays.iter().map(|ray| ray.light).collect(),
            object,
            background,
        }
    }

    /// All of it, ray by ray and front to back.
    fn in_order(self, through_object: bool) -> (MarchedBatch, Look) {
        let rays = self.marched.rays.len();
        let order = by_ray(&self.ray, rays);
        let object = by_ray(&self.samples.object.ray, rays);
        let background = by_ray(&self.samples.background.ray, rays);
        let intervals: Vec<u32> = select(&self.interval, &order);
        let mut offsets = vec![0; rays + 1];
        for ray in &self.ray {
            offsets[*ray as usize + 1] += 1;
        }
        for ray in 0..rays {
            offsets[ray + 1] += offsets[ray];
        }
        let t = &self.marched.intervals.t;
        let marched = MarchedBatch {
            packing: Packing::new(
                offsets,
                intervals.iter().map(|&i| t[i as usize]).collect(),
                select(&self.dt, &order),
                numbers(&intervals, &select(&self.samples.object_intervals, &object)),
                numbers(
                    &intervals,
                    &select(&self.samples.background_intervals, &background),
                ),
            ),
            object: self.samples.object.select(&object),
            background: self.samples.background.select(&background),
        };
        let look = Look {
            object: self.object.select(&object),
            background: self.background.select(&background),
            visibility: SampleVisibility {
                object: select(&self.visibility.object, &object),
                background: select(&self.visibility.background, &background),
            },
            through_object,
        };
        (marched, look)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;
    use hashgrid::{GridConfig, GridLayout};
    use neus_render::composite::sample_visibility;
    use neus_render::march::{Grids, Jitter, MarchConfig};
    use neus_render::rays::Ray;
    use scene_decomp::probability::ProbabilityMap;
    use scene_decomp::{BACKGROUND_HALF_SIDE, InitialShape, Surface, SurfaceConfig};

    use super::*;
    use crate::train::batch::BatchMarcher;
    use crate::train::grids::FieldGrids;

    fn field(half_side: f32, initial: InitialShape) -> FrozenSurface {
        let grid = GridConfig {
            levels: 2,
            log2_table_size: 8,
            ..GridConfig::default()
        };
        let config = SurfaceConfig {
            grid: grid.clone(),
            hidden: 16,
            features: 2,
            extra: 0,
            direction_degree: 0,
            outputs: 3,
            half_side,
            beta: 100.0,
            initial,
        };
        let layout = Arc::new(GridLayout::new(&grid));
        FrozenSurface::new(&Surface::new(&config, 3, &Device::flex()), &layout, 2)
    }

    /// Past a ball in a hollow: some rays end at the ball, some at the far wall.
    #[test]
    fn what_light_reaches_is_what_asking_about_everything_gives() {
        let fields = [
            field(1.0, InitialShape::Ball(0.5)),
            field(BACKGROUND_HALF_SIDE, InitialShape::Hollow(1.3)),
        ];
        let map = ProbabilityMap::new(8, vec![0.5; 512]);
        let grids = FieldGrids::new(16, &map, 0.5);
        let rays: Vec<Ray> = (0..100)
            .map(|i| {
                let at = Vec3::new(
                    0.2 * (i % 10) as f32 - 0.9,
                    0.2 * (i / 10) as f32 - 0.9,
                    0.0,
                );
                let from = Vec3::new(0.3, -0.2, -1.2);
                Ray::new(from, at - from).expect("a direction")
            })
            .collect();
        let rules = Rules {
            transparency: [Transparency::Sdf; 2],
            through_object: false,
            sharpness: [60.0, 90.0],
            compositing: CompositeConfig::default(),
            taped: [true, false],
        };
        let mut marcher = BatchMarcher::default();
        let marched = marcher.march(
            &rays,
            Grids {
                object: Some(&grids.object),
                background: Some(&grids.background),
            },
            &MarchConfig {
                step_object: 2.0 / 64.0,
                background_samples: 32,
                jitter: Jitter::Seeded(5),
                ..MarchConfig::default()
            },
            grids.partition(&map, false),
        );
        let alone = |ray: usize| Alone {
            object: ray % 3 == 1,
            background: ray % 2 == 1,
        };
        let (batch, look) = super::look(&fields[0], &fields[1], marched, rules, alone);

        let all = marched.samples();
        let geometry = [
            fields[0].geometry(&all.object.points),
            fields[1].geometry(&all.background.points),
        ];
        let visibility = sample_visibility(
            &rows::<{ object_column::COUNT }>(
                &geometry[0],
                Transparency::Sdf,
                &all.object.directions,
                |row| row[object_column::MATTE] = 1.0,
            ),
            &rows::<{ background_column::COUNT }>(
                &geometry[1],
                Transparency::Sdf,
                &all.background.directions,
                |_| {},
            ),
            rules.sharpness,
            &all.packing,
            rules.compositing,
        );
        let [object, background] = geometry;
        let everything = Look {
            object,
            background,
            visibility,
            through_object: false,
        };
        assert!(batch.object.len() < all.object.len());
        assert!(batch.background.len() < all.background.len());
        let of = |batch: &MarchedBatch, look: &Look| {
            let object = look.object_reached(|i| alone(batch.object.ray[i] as usize).object);
            let background =
                look.background_reached(|i| alone(batch.background.ray[i] as usize).background);
            assert!(object.len() > 100 && background.len() > 100);
            let kept = batch.keep(&object, &background);
            let seen = (
                select(&look.visibility.object, &object),
                select(&look.visibility.background, &background),
            );
            let sdf = [
                look.object.select(&object).values,
                look.background.select(&background).values,
            ];
            (kept, seen, sdf)
        };
        let (found, seen, sdf) = of(&batch, &look);
        let (expected, expected_seen, expected_sdf) = of(&all, &everything);
        assert_eq!(found.packing, expected.packing);
        assert_eq!(found.object.points, expected.object.points);
        assert_eq!(found.object.ray, expected.object.ray);
        assert_eq!(found.background.points, expected.background.points);
        assert_eq!(found.background.directions, expected.background.directions);
        assert_eq!(found.background.ray, expected.background.ray);
        assert_eq!(seen, expected_seen);
        assert_eq!(sdf, expected_sdf);
        assert_eq!(found.object.taped.len(), found.object.len());
        assert!(found.background.taped.is_empty());

        // Where light goes on through the object, more of it is looked at, and weighs what it weighed.
        let rules = Rules {
            through_object: true,
            ..rules
        };
        let nobody = |_| Alone::default();
        let (_, through) = super::look(&fields[0], &fields[1], marched, rules, nobody);
        let [more, fewer] =
            [&through, &everything].map(|look| look.object_reached(|_| false).len());
        assert!(more > fewer + fewer / 5, "{more}, {fewer}");
        let [with, without] = [&through, &everything].map(|look| {
            let weights = look.visibility.object.iter().map(|seen| seen.weight);
            weights.sum::<f32>()
        });
        assert!((with - without).abs() < 1e-3 * without, "{with}, {without}");
    }
}
