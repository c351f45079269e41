//! The distortion loss of mip-NeRF 360 (Barron et al. 2022, eq. 15): light should come from one place.
//!
//! ```text
//! L = sum_ij w_i w_j |s_i - s_j|        per ray, over the samples of both fields
//! ```
//!
//! Its derivative with respect to `w_i` is `2 sum_j w_j |s_i - s_j|`. With that as a mark of the
//! samples, compositing gives a pixel whose gradient is the loss's: no op of its own is needed. It clears fog, and most of all floaters that make up for a highlight.
//!
//! What else is a price of light by where it comes from is a mark as well: from far away, and from elsewhere than where a ray is
//! known to end ([`Sights`](crate::prepare::Sights)).

use glam::Vec3;
use neus_render::composite::Marks;
use neus_render::contraction::contract;

use super::batch::MarchedBatch;
use super::visible::Look;

/// Samples this near to where a ray is known to end are there: places are not exact, and surfaces are not thin. In contracted
/// space, where the box's half side is 1.
const AT_END: f32 = 0.03;
/// From that much farther on all are equally wrong.
const OFF_END: f32 = 0.1;

/// `2 sum_j w_j |s_i - s_j|` of every sample.
#[derive(Clone, Debug, Default)]
pub struct Spread {
    /// FoCoR's samples, `[m_f]`.
    pub object: Vec<f32>,
    /// BaCo's, `[m_b]`.
    pub background: Vec<f32>,
    /// Of BaCo's samples, how far outside the box they lie, 0 in the box and 1 at infinity; on rays whose end is known how far
    /// from that, 0 to 1. `[m_b]`
    pub off_background: Vec<f32>,
    /// Of FoCoR's, how far from the known end of their ray; 0 on others. `[m_f]`
    pub off_object: Vec<f32>,
}

impl Spread {
    /// Appends what is known of further samples.
    pub(super) fn append(&mut self, other: Self) {
        self.object.extend(other.object);
        self.background.extend(other.background);
        self.off_background.extend(other.off_background);
        self.off_object.extend(other.off_object);
    }

    /// The spread of every sample, and how far outside the box, or from the known end of its ray, it lies.
    #[must_use]
    pub(super) fn marks(&self) -> Marks {
        Marks {
            object: pairs(&self.object, &self.off_object),
            background: pairs(&self.background, &self.off_background),
        }
    }

    /// Of the samples with these row numbers.
    #[must_use]
    pub fn select(&self, object: &[u32], background: &[u32]) -> Self {
        let of = |values: &[f32], rows: &[u32]| rows.iter().map(|&i| values[i as usize]).collect();
        Self {
            object: of(&self.object, object),
            background: of(&self.background, background),
            off_background: of(&self.off_background, background),
            off_object: of(&self.off_object, object),
        }
    }
}

/// Each of `a` with that of `b`.
fn pairs(a: &[f32], b: &[f32]) -> Vec<[f32; 2]> {
    a.iter().zip(b).map(|(&a, &b)| [a, b]).collect()
}

/// The spread of all rays; positions are lengths along the ray in contracted space, over that
/// space's half side. `ends` is where they are known to end, in the normalised frame.
#[must_use]
pub fn spread(marched: &MarchedBatch, look: &Look, ends: &[Option<Vec3>]) -> Spread {
    let packing = &marched.packing;
    let mut out = Spread {
        object: vec![0.0; marched.object.len()],
        background: vec![0.0; marched.background.len()],
        off_background: marched.background.points.chunks_exact(3).map(far).collect(),
        off_object: vec![0.0; marched.object.len()],
    };
    // (is BaCo's, row, weight, position) of one ray, front to back.
    let mut ray_samples: Vec<(bool, usize, f32, f32)> = Vec::new();
    for ray in 0..packing.ray_count() {
        let range = |offsets: &[u32]| offsets[ray] as usize..offsets[ray + 1] as usize;
        let mut object = range(packing.object_offsets()).peekable();
        let mut background = range(packing.background_offsets()).peekable();
        ray_samples.clear();
        let (mut position, mut last) = (0.0, None::<Vec3>);
        loop {
            let interval = |row: Option<&usize>, of: &[u32]| row.map(|&row| of[row]);
            let next_object = interval(object.peek(), packing.object());
            let next_background = interval(background.peek(), packing.background());
            let of_object = match (next_object, next_background) {
                (None, None) => break,
                (Some(a), Some(b)) => a <= b,
                (a, _) => a.is_some(),
            };
            let (rows, samples, seen) = if of_object {
                (&mut object, &marched.object, &look.visibility.object)
            } else {
                (
                    &mut background,
                    &marched.background,
                    &look.visibility.background,
                )
            };
            let Some(row) = rows.next() else { break };
            let point = Vec3::from_slice(&samples.points[3 * row..]);
            position += last.map_or(0.0, |last| point.distance(last));
            last = Some(point);
            ray_samples.push((!of_object, row, seen[row].weight, 0.5 * position));
        }
        if let Some(end) = ends[ray].map(contract) {
            let at = |points: &[f32], row: usize| astray(&points[3 * row..], end);
            for row in range(packing.object_offsets()) {
                out.off_object[row] = at(&marched.object.points, row);
            }
            for row in range(packing.background_offsets()) {
                out.off_background[row] = at(&marched.background.points, row);
            }
        }
        // Two sweeps with running sums make the double sum linear.
        let total: f32 = ray_samples.iter().map(|s| s.2).sum();
        let moment: f32 = ray_samples.iter().map(|s| s.2 * s.3).sum();
        let (mut weight, mut sum) = (0.0, 0.0);
        for &(of_background, row, w, s) in &ray_samples {
            // sum_j<i w_j (s_i - s_j) + sum_j>i w_j (s_j - s_i)
            let before = s * weight - sum;
            weight += w;
            sum += w * s;
            let after = (moment - sum) - s * (total - weight);
            let value = 2.0 * (before + after);
            if of_background {
                out.background[row] = value;
            } else {
                out.object[row] = value;
            }
        }
    }
    out
}

/// How far a sample's point is from where its ray ends, 0 to 1; both in contracted space, where what is far away is as near
/// together as samples are there.
fn astray(contracted: &[f32], end: Vec3) -> f32 {
    ((Vec3::from_slice(contracted).distance(end) - AT_END) / OFF_END).clamp(0.0, 1.0)
}

/// How far outside the box a point of contracted space lies, 0 to 1.
///
/// A camera that looks down at a table from one side is the only one to look that way. So the far
/// end of its rays can be painted with its photo, and the table need not exist: no other photo
/// objects, but plates show the hole. Light from far away has a price until geometry is there.
fn far(contracted: &[f32]) -> f32 {
    (Vec3::from_slice(contracted).abs().max_element() - 1.0).clamp(0.0, 1.0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use demo_scene::DemoConfig;
    use neus_render::composite::{Packing, SampleVisibility, Visibility};
    use scene_decomp::Geometry;

    use super::*;
    use crate::prepare::Sights;
    use crate::train::batch::FieldSamples;
    use crate::train::{Trainer, tiny};

    fn samples(at: &[f32]) -> FieldSamples {
        FieldSamples {
            points: at.iter().flat_map(|x| [*x, 0.0, 0.0]).collect(),
            directions: at.iter().flat_map(|_| [1.0, 0.0, 0.0]).collect(),
            ray: vec![0; at.len()],
            ..FieldSamples::default()
        }
    }

    #[test]
    fn the_spread_is_the_double_sum() {
        // Along x: the object at -0.5 and 0.1, the background at -0.9, 0.1 and 0.7.
        let marched = MarchedBatch {
            packing: Packing::new(
                vec![0, 4],
                vec![0.1, 0.5, 1.1, 1.7],
                vec![0.1; 4],
                vec![1, 2],
                vec![0, 2, 3],
            ),
            object: samples(&[-0.5, 0.1]),
            background: samples(&[-0.9, 0.1, 0.7]),
        };
        let weights = |of: &[f32]| -> Vec<Visibility> {
            of.iter()
                .map(|&weight| Visibility {
                    weight,
                    ..Visibility::default()
                })
                .collect()
        };
        let look = Look {
            object: Geometry::default(),
            background: Geometry::default(),
            visibility: SampleVisibility {
                object: weights(&[0.3, 0.2]),
                background: weights(&[0.1, 0.15, 0.25]),
            },
            through_object: false,
        };
        let found = spread(&marched, &look, &[None]);
        let all = [
            (-0.9f32, 0.1f32),
            (-0.5, 0.3),
            (0.1, 0.2),
            (0.1, 0.15),
            (0.7, 0.25),
        ];
        let expected =
            |x: f32| -> f32 { all.iter().map(|(at, weight)| weight * (x - at).abs()).sum() };
        for (found, x) in found.object.iter().zip([-0.5, 0.1]) {
            assert!((found - expected(x)).abs() < 1e-6, "{found}");
        }
        assert_eq!(found.off_background, [0.0; 3]);
        assert_eq!(far(&[0.2, -1.5, 1.0]), 0.5);
        for (found, x) in found.background.iter().zip([-0.9, 0.1, 0.7]) {
            assert!((found - expected(x)).abs() < 1e-6, "{found}");
        }
        // The ray ends a little behind what is at 0.1, as a place outside the box has it.
        let end = Vec3::new(0.1, AT_END + 0.5 * OFF_END, 0.0);
        let found = spread(&marched, &look, &[Some(end)]);
        let marks = found.marks();
        let second = |marks: &[[f32; 2]]| -> Vec<f32> { marks.iter().map(|m| m[1]).collect() };
        assert_eq!(second(&marks.object)[0], 1.0);
        assert!((second(&marks.object)[1] - 0.5).abs() < 1e-5);
        assert_eq!(second(&marks.background)[0], 1.0);
        assert!((second(&marks.background)[1] - 0.5).abs() < 1e-5);
        assert_eq!(astray(&[1.5, 0.0, 0.0], contract(Vec3::X * 2.0)), 0.0);
    }

    #[test]
    fn light_comes_to_be_from_where_rays_are_known_to_end() {
        let astray_after = |weight: f32| {
            let mut config = tiny::config();
            config.loss.sight = weight;
            config.sampling.sight_share = 0.3;
            // BaCo by itself, as in a search.
            config.schedule.carve = 1.0;
            config.schedule.warmup_steps = 10;
            config.steps = 800;
            let mut data = tiny::prepared(&config, &[]);
            let points = demo_scene::generate(&DemoConfig::tiny()).points;
            data.sights = Sights::new(points.iter().map(|point| {
                let views = point.observations.iter().map(|seen| seen.view as u32);
                (point.position, views.collect())
            }));
            assert!(!data.sights.is_empty());
            let mut trainer = Trainer::new(&config, &data).unwrap();
            // Before its weight falls.
            let losses: Vec<f32> = (0..240).map(|_| trainer.step(&data).losses.sight).collect();
            losses[200..].iter().sum::<f32>() / 40.0
        };
        // Next to nothing, so that it is only looked at.
        let (without, with) = (astray_after(1e-6), astray_after(0.1));
        assert!(with < 0.6 * without, "{with} instead of {without}");
    }
}
