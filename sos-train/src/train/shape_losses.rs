//! What is asked of FoCoR's distance beside the photos, at places of its own choosing.

use burn::Tensor;
use glam::Vec3;
use losses::{RowLoss, RowTerm, curvature_loss, row_losses};
use rand::{Rng, RngExt};
use scene_decomp::Scene;
use scene_decomp::probability::ProbabilityMap;

use super::ledger::Entry;
use super::sampler::step_random;
use super::step::{StepContext, StepSchedule, constant};
use super::total::Weighed;

/// Points of the box that the sparsity loss looks at in each step.
const SPARSITY_POINTS: usize = 512;
/// Sparse points that each step asks for.
const SURFACE_POINTS: usize = 256;
/// Samples whose normals are compared with a neighbour's in each step.
const CURVATURE_POINTS: usize = 512;

/// m^P from which on a sparse point is taken to lie on the object: one that masks are not agreed on
/// may be a neighbour's.
const SURE: f32 = 0.85;

/// Those of `points` that `map` certainly gives to the object.
pub(super) fn surely_of_object(points: &[Vec3], map: &ProbabilityMap) -> Vec<Vec3> {
    let points = points.iter().copied();
    points.filter(|point| map.at(*point) >= SURE).collect()
}

/// Points, one kind after the other, and what is asked of each kind.
#[derive(Default)]
struct Asked {
    points: Vec<f32>,
    /// How many there are of each kind.
    counts: Vec<usize>,
    losses: Vec<RowLoss>,
    weights: Vec<f32>,
    entries: Vec<Entry>,
}

impl Asked {
    /// Asks the mean of `loss` over `points`, `[n * 3]`.
    fn add(&mut self, points: impl Iterator<Item = f32>, loss: RowLoss, weight: f32, entry: Entry) {
        let before = self.points.len();
        self.points.extend(points);
        self.counts.push((self.points.len() - before) / 3);
        self.losses.push(loss);
        self.weights.push(weight);
        self.entries.push(entry);
    }

    fn losses_of(&self, shape: Shape<'_>) -> Tensor<1> {
        let kinds = self.losses.len();
        // A row for each point, with the weight that its kind's mean gives it.
        let rows = self.counts.iter().enumerate().flat_map(|(kind, count)| {
            let row = (0..kinds).map(move |of| if of == kind { 1.0 / *count as f32 } else { 0.0 });
            std::iter::repeat_n(row, *count).flatten()
        });
        let known = constant(&rows.collect::<Vec<f32>>(), kinds, &shape.context.device);
        let terms = self.losses.iter().enumerate();
        let terms = terms.map(|(weight, loss)| RowTerm {
            loss: *loss,
            weight,
        });
        row_losses(shape.geometry(&self.points), known, terms.collect())
    }
}

/// FoCoR at one step.
#[derive(Clone, Copy)]
pub(super) struct Shape<'a> {
    pub(super) context: &'a StepContext,
    pub(super) scene: &'a Scene,
    pub(super) schedule: StepSchedule,
}

impl Shape<'_> {
    /// What is asked of the distance at points of the step's own choosing, in one look at all of them: L_sparsity of random
    /// points of the box, which is mostly where no ray ever looks, and how far some of the object's sparse points are from
    /// the surface.
    ///
    /// For sparsity samples of rays will not do: those that light reaches lie before the surface, and keeping them
    /// off it would wear the object away.
    pub(super) fn distances(self) -> Option<Weighed> {
        let weights = &self.context.config.loss;
        let mut asked = Asked::default();
        if weights.sparsity > 0.0 {
            let mut random = self.random(0x05ba_25e0);
            let points = (0..3 * SPARSITY_POINTS).map(|_| random.random_range(-1.0..1.0));
            let tau = weights.sparsity_tau;
            let loss = RowLoss::Sparsity { sdf: 0, tau };
            asked.add(points, loss, weights.sparsity, |losses| {
                &mut losses.sparsity
            });
        }
        let points = &self.context.points;
        if weights.points > 0.0 && !points.is_empty() {
            let mut random = self.random(0x0901_4720);
            let chosen = (0..SURFACE_POINTS)
                .flat_map(|_| points[random.random_range(0..points.len())].to_array());
            let loss = RowLoss::Surface { sdf: 0 };
            asked.add(chosen, loss, weights.points, |losses| &mut losses.points);
        }
        (!asked.losses.is_empty()).then(|| Weighed {
            losses: asked.losses_of(self),
            weights: asked.weights,
            entries: asked.entries,
        })
    }

    /// How much normals differ between some of `samples` `[m * 3]`, not empty, and points a finest cell
    /// away from them in any direction: as cells become smaller, so does what it smooths.
    pub(super) fn curvature(self, samples: &[f32]) -> Tensor<1> {
        let mut random = self.random(0x0c07_a7e5);
        let levels = &self.context.object_layout.levels;
        let finest = &levels[self.schedule.active_levels.clamp(1, levels.len()) - 1];
        // The box is 2 wide.
        let step = 2.0 / finest.resolution as f32;
        let n = samples.len() / 3;
        let mut points = Vec::with_capacity(6 * CURVATURE_POINTS);
        let mut neighbours = Vec::with_capacity(3 * CURVATURE_POINTS);
        for _ in 0..CURVATURE_POINTS {
            let i = random.random_range(0..n);
            let point = Vec3::from_slice(&samples[3 * i..3 * i + 3]);
            let neighbour = point + step * any_direction(&mut random);
            points.extend(point.to_array());
            neighbours.extend(neighbour.clamp(Vec3::NEG_ONE, Vec3::ONE).to_array());
        }
        points.append(&mut neighbours);
        let geometry = self.geometry(&points);
        let [rows, columns] = geometry.dims();
        let normals = geometry.slice([0..rows, columns - 3..columns]);
        let [here, there] = [0..CURVATURE_POINTS, CURVATURE_POINTS..rows]
            .map(|rows| normals.clone().slice([rows, 0..3]));
        curvature_loss(here, there, None)
    }

    /// Distance, features and gradient at `points` `[n * 3]`, `[n, 1 + G + 3]`.
    fn geometry(self, points: &[f32]) -> Tensor<2> {
        let object = &self.scene.object;
        object.geometry(
            constant(points, 3, &self.context.device),
            object.sdf_config(
                &self.context.object_layout,
                self.schedule.active_levels,
                Some(self.context.object_gradient.clone()),
            ),
        )
    }

    fn random(self, stream: u64) -> impl Rng + use<> {
        step_random(self.context.config.seed ^ stream, self.schedule.step)
    }
}

/// A unit vector, all being as likely.
fn any_direction(random: &mut impl Rng) -> Vec3 {
    loop {
        let v = Vec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
        let squared = v.length_squared();
        if (1e-6..1.0).contains(&squared) {
            return v / squared.sqrt();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_points_that_are_surely_the_objects_are_held_to() {
        // Of no doubt where z is negative, of some where it is not.
        let n = 8;
        let values = (0..n * n * n).map(|cell| if cell / (n * n) < n / 2 { 1.0 } else { 0.7 });
        let map = ProbabilityMap::new(n, values.collect());
        let (sure, doubtful) = (Vec3::new(0.1, 0.2, -0.6), Vec3::new(0.1, 0.2, 0.6));
        let outside = Vec3::new(0.0, 0.0, -1.5);
        assert_eq!(surely_of_object(&[doubtful, sure, outside], &map), [sure]);
    }
}
