//! From which share of its votes on a place is the object's, where masks err more to one side.
//!
//! Masks that lose a part, another one in each view, call much of the object background and next to
//! nothing else object: a place that a third of the views call object is the object's, as nobody says
//! so of any other place. Masks that include a neighbour are the opposite. How often masks err to
//! either side shows in the votes themselves: on places that most views call object, and on those
//! around that most call background. From both rates follows the share at which both answers are as
//! likely, if views err by themselves (Dawid and Skene 1979).

use rayon::prelude::*;

use super::SurfaceVotes;
use super::spread::spread;

/// Voxels around the object whose votes tell how often background is called object: half of them.
const AROUND: usize = 4;
/// No rate is believed to be lower than this: errors of several views at one place are not by chance.
const LEAST_RATE: f64 = 0.02;
/// Masks whose tipping point is no farther than this from one half err to both sides, more or less.
const LEAST_LEAN: f64 = 0.08;
/// Votes that decide nothing: what is left of a mean over a window after the sum has come back to zero.
const NOTHING: f32 = 1e-6;
/// Each round tells object from background by what the one before found.
const ROUNDS: usize = 4;

impl SurfaceVotes {
    /// The share of votes for the object from which on a place is more likely the object's than not;
    /// one half where masks err to both sides alike, or where nothing was voted on.
    #[must_use]
    pub fn tipping_point(&self) -> f32 {
        let voted = |cell: usize| self.total[cell] > NOTHING;
        let share = |cell: usize| f64::from(self.object[cell]) / f64::from(self.total[cell]);
        // Where most say object, and around it: all else is far from any outline.
        let most: Vec<f32> = (0..self.total.len())
            .into_par_iter()
            .map(|cell| f32::from(u8::from(voted(cell) && share(cell) > 0.5)))
            .collect();
        let near = spread(&most, self.resolution, AROUND);
        let near: Vec<usize> = (0..near.len())
            .into_par_iter()
            .filter(|&cell| near[cell] > NOTHING && voted(cell))
            .collect();
        let mut tipping = 0.5;
        for _ in 0..ROUNDS {
            // Votes for and in all, on the object and around it.
            let mut sums = [[0.0f64; 2]; 2];
            for &cell in &near {
                let [votes, all] = &mut sums[usize::from(share(cell) <= tipping)];
                *votes += f64::from(self.object[cell]);
                *all += f64::from(self.total[cell]);
            }
            let [Some(hit), Some(false_alarm)] =
                sums.map(|[votes, all]| (all > 0.0).then(|| votes / all))
            else {
                return 0.5;
            };
            tipping = balance(hit, false_alarm);
        }
        if (tipping - 0.5).abs() < LEAST_LEAN {
            return 0.5;
        }
        tipping as f32
    }
}

/// The share of votes at which object and background are as likely, where one is called object in the
/// share `hit` of views and the other in the share `false_alarm`.
fn balance(hit: f64, false_alarm: f64) -> f64 {
    let hit = hit.clamp(0.5, 1.0 - LEAST_RATE);
    let false_alarm = false_alarm.clamp(LEAST_RATE, 0.5 - LEAST_RATE);
    let against = ((1.0 - false_alarm) / (1.0 - hit)).ln();
    let for_it = (hit / false_alarm).ln();
    against / (against + for_it)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// A block of object on a floor; each place has a hundred votes, of which `hits` and `alarms` say
    /// "object" of the block and of the floor.
    fn votes(hits: u32, alarms: u32) -> SurfaceVotes {
        let mut votes = SurfaceVotes::new(32);
        for x in -12..12 {
            for y in -12..12 {
                let block = i32::abs(x) < 5 && i32::abs(y) < 5;
                for k in 0..100 {
                    let place = Vec3::new(x as f32 + 0.5, y as f32 + 0.5, 0.5) / 16.0;
                    votes.add(place, 1.0, k < if block { hits } else { alarms });
                }
            }
        }
        votes
    }

    #[test]
    fn masks_that_err_to_both_sides_alike_leave_it_to_the_majority() {
        for error in [0, 5, 20, 40] {
            let found = votes(100 - error, error).tipping_point();
            assert_eq!(found, 0.5, "{error}");
        }
        assert_eq!(SurfaceVotes::new(8).tipping_point(), 0.5);
    }

    #[test]
    fn lost_parts_lower_it_and_neighbours_raise_it() {
        let lost = votes(75, 1).tipping_point();
        let included = votes(99, 25).tipping_point();
        assert!((0.25..0.35).contains(&lost), "{lost}");
        assert!((included + lost - 1.0).abs() < 0.02, "{included} {lost}");
    }
}
