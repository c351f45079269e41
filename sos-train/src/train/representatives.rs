//! Fewer samples that stand for many: what a step learns from, of all that light reaches.
//!
//! A ray crosses more space than it sees. Of a density, neighbours that hide little are drawn as one; of a surface,
//! samples in clear space, which nothing shows, are thinned out.

use neus_render::composite::Visibility;
use rand::{Rng, RngExt};
use scene_decomp::colour_field::density_of;

use super::batch::MarchedBatch;
use super::visible::{LEAST_TRANSMITTANCE, Look};

/// Samples that stand for all of a ray's.
#[derive(Clone, Debug, Default)]
pub struct Representatives {
    /// Row numbers, ascending.
    pub rows: Vec<u32>,
    /// What each one's density has to be multiplied with; empty when each stands for itself.
    pub stretch: Vec<f32>,
    /// What each one counts for in means over samples; empty when each counts once.
    pub stands_for: Vec<f32>,
}

/// Samples less opaque than this are in clear space: one changes a pixel by less than a 300th of what 8 bits can tell.
const CLEAR: f32 = 1e-5;

impl Representatives {
    /// Samples that stand for themselves.
    #[must_use]
    pub fn all(rows: Vec<u32>) -> Self {
        Self {
            rows,
            ..Self::default()
        }
    }

    /// Of `rows` that are in clear space only a `share`, in (0, 1], evenly, from one at `random` on; `seen` is what
    /// every row lets through.
    ///
    /// They show nothing, but keep a distance a distance (eikonal loss) where light passes through. So those that are
    /// left count for those that are not, and means over samples stay what they are on average; their gradients become
    /// noisier.
    #[must_use]
    pub fn thinned(rows: Vec<u32>, seen: &[Visibility], share: f32, random: &mut impl Rng) -> Self {
        if share >= 1.0 {
            return Self::all(rows);
        }
        let mut out = Self::default();
        let mut due: f32 = random.random();
        for row in rows {
            let mut count = 1.0;
            if seen[row as usize].opacity < CLEAR {
                due += share;
                if due < 1.0 {
                    continue;
                }
                due -= 1.0;
                count = 1.0 / share;
            }
            out.rows.push(row);
            out.stands_for.push(count);
        }
        out
    }
}

/// Neighbours on a ray are drawn as one while they hide less than this share of the pixel,
const GROUP_WEIGHT: f32 = 0.08;
/// and while they are no more than this.
const GROUP_SIZE: usize = 8;

impl Look {
    /// Draws representatives of the background's samples, for a field read as a density.
    ///
    /// Neighbours on a ray that together hide little form a group; one of them is drawn with a
    /// probability proportional to its optical depth, and its density stretched to the optical
    /// depth of all. So a ray's transmittance stays what it is, and on average so do colours and
    /// gradients, for a third of the samples.
    #[must_use]
    pub fn background_drawn(
        &self,
        marched: &MarchedBatch,
        alone: impl Fn(usize) -> bool,
        random: &mut impl Rng,
    ) -> Representatives {
        let packing = &marched.packing;
        let mut out = Representatives::default();
        for ray in 0..packing.ray_count() {
            let rows = packing.background_offsets()[ray]..packing.background_offsets()[ray + 1];
            let objects = &packing.object()[packing.object_offsets()[ray] as usize
                ..packing.object_offsets()[ray + 1] as usize];
            let mut group = Group::default();
            for row in rows {
                let i = row as usize;
                let seen = &self.visibility.background[i];
                let light = if alone(ray) {
                    seen.alone
                } else {
                    seen.transmittance
                };
                if light <= LEAST_TRANSMITTANCE {
                    break;
                }
                let interval = packing.background()[i];
                let parted = group.count > 0
                    && objects.partition_point(|&o| o < group.last)
                        != objects.partition_point(|&o| o < interval);
                if parted || group.weight >= GROUP_WEIGHT || group.count >= GROUP_SIZE {
                    group.close(&mut out);
                }
                let depth = density_of(self.background.sdf(i)) * packing.dt()[interval as usize];
                group.depth += depth;
                if group.count == 0 || random.random::<f32>() * group.depth < depth {
                    (group.row, group.own) = (row, depth);
                }
                group.weight += light * -(-depth).exp_m1();
                group.count += 1;
                group.last = interval;
            }
            group.close(&mut out);
        }
        out
    }
}

/// Neighbouring samples of one ray, and the one drawn among them.
#[derive(Clone, Copy, Debug, Default)]
struct Group {
    count: usize,
    /// The last one's interval.
    last: u32,
    row: u32,
    /// Optical depth of `row`, and of all.
    own: f32,
    depth: f32,
    weight: f32,
}

impl Group {
    fn close(&mut self, out: &mut Representatives) {
        if self.count > 0 {
            out.rows.push(self.row);
            out.stretch.push(self.depth / self.own.max(1e-12));
        }
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::train::visible::tests::scene;

    #[test]
    fn representatives_keep_the_optical_depth() {
        let (marched, look) = scene();
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let drawn = look.background_drawn(&marched, |_| false, &mut random);
        assert!(drawn.rows.is_sorted_by(|a, b| a < b));
        let reached = look.background_reached(|_| false);
        assert!(2 * drawn.rows.len() < reached.len(), "{}", drawn.rows.len());
        let depth = |row: u32| density_of(look.background.sdf(row as usize)) * 0.1;
        let whole: f32 = reached.iter().map(|row| depth(*row)).sum();
        let kept: f32 = drawn
            .rows
            .iter()
            .zip(&drawn.stretch)
            .map(|(row, stretch)| stretch * depth(*row))
            .sum();
        assert!((kept / whole - 1.0).abs() < 1e-4, "{kept} {whole}");
    }

    #[test]
    fn representatives_are_fair() {
        let (marched, look) = scene();
        // Each sample's optical depth, on average over many draws, is its own.
        let mut sums = vec![0.0f64; 40];
        let draws = 20_000;
        let mut random = Pcg64Mcg::seed_from_u64(5);
        for _ in 0..draws {
            let drawn = look.background_drawn(&marched, |_| false, &mut random);
            for (row, stretch) in drawn.rows.iter().zip(&drawn.stretch) {
                let depth = density_of(look.background.sdf(*row as usize)) * 0.1 * stretch;
                sums[*row as usize] += f64::from(depth) / f64::from(draws);
            }
        }
        // The later ones share a group with the wall, which is nearly always drawn.
        for (row, sum) in sums.iter().enumerate().take(8) {
            let own = f64::from(density_of(look.background.sdf(row)) * 0.1);
            assert!((sum / own - 1.0).abs() < 0.1, "{row}: {}", sum / own);
        }
    }

    fn random() -> Pcg64Mcg {
        Pcg64Mcg::seed_from_u64(7)
    }

    /// Every third sample is opaque.
    fn mostly_clear() -> Vec<Visibility> {
        let opacity = |i| if i % 3 == 0 { 0.1 } else { 0.0 };
        let seen = |i| Visibility {
            opacity: opacity(i),
            ..Visibility::default()
        };
        (0..300).map(seen).collect()
    }

    #[test]
    fn only_clear_samples_are_thinned() {
        let seen = mostly_clear();
        let rows: Vec<u32> = (30..300).collect();
        let thinned = Representatives::thinned(rows, &seen, 0.25, &mut random());
        assert!(thinned.rows.is_sorted_by(|a, b| a < b));
        let opaque = |row: &u32| row.is_multiple_of(3);
        assert!(
            (30..300)
                .filter(opaque)
                .all(|row| thinned.rows.contains(&row))
        );
        assert_eq!(thinned.rows.len(), 90 + 45);
        for (row, count) in thinned.rows.iter().zip(&thinned.stands_for) {
            assert_eq!(*count, if opaque(row) { 1.0 } else { 4.0 });
        }
        assert_eq!(thinned.stands_for.iter().sum::<f32>(), 270.0);
    }

    #[test]
    fn any_clear_sample_may_be_the_one_that_is_left() {
        let seen = mostly_clear();
        let (mut random, draws) = (random(), 4000);
        let mut left = [0; 30];
        for _ in 0..draws {
            let thinned = Representatives::thinned((0..30).collect(), &seen, 0.25, &mut random);
            for row in thinned.rows {
                left[row as usize] += 1;
            }
        }
        for (row, count) in left.into_iter().enumerate() {
            let share = count as f32 / draws as f32;
            let expected = if row % 3 == 0 { 1.0 } else { 0.25 };
            assert!((share - expected).abs() < 0.03, "{row}: {share}");
        }
    }

    #[test]
    fn a_share_of_one_keeps_all() {
        let all = Representatives::thinned(vec![1, 2, 7], &mostly_clear(), 1.0, &mut random());
        assert_eq!(all.rows, [1, 2, 7]);
        assert!(all.stands_for.is_empty());
    }
}
