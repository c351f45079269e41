//! The parts that are left of a scene when its support is taken away.

use glam::Vec3;
use scene_decomp::probability::ProbabilityMap;

use super::beside::stands_beside;
use super::cores::cores;
use super::gaze::Gaze;
use super::hanging::holders;
use super::part_set::{BORDER_SHARE, PartSet, at_border, voxel};
use super::plane::{Plane, height_above};
use super::standing::things;
use crate::train::carve::fusion::seen_surface;
use crate::voxels::{components, neighbours};

/// What a part counts that goes on beyond the region.
const CUT_OFF: f32 = 0.1;
/// Parts with less than this share of the chosen one's voxels are crumbs.
const CRUMB: f32 = 0.002;
/// Parts this close to the chosen one's bounds belong to it, in the normalised frame.
const REACH: f32 = 0.04;
/// What hangs in the air belongs to what holds it from this share of its voxels on: less may be haze.
const HELD: f32 = 0.02;
/// Voxels of the smallest part worth a thought.
pub(super) const LEAST_VOXELS: usize = 40;

/// Connected sets of seen solid voxels.
#[derive(Debug)]
pub struct Parts {
    resolution: usize,
    /// What lies above the ground, seen or not.
    solid: Vec<bool>,
    /// The part of each voxel, from 1 on; 0 is none.
    labels: Vec<u32>,
    /// By number, from 1 on.
    parts: Vec<Part>,
    /// The ground, if things stand on it.
    floor: Option<Plane>,
    gaze: Gaze,
    /// What no set has, whichever parts are next to it.
    barred: Vec<bool>,
}

#[derive(Clone, Debug, Default)]
struct Part {
    voxels: usize,
    border: usize,
    /// Sum of how central its voxels are.
    central: f32,
    low: Vec3,
    high: Vec3,
    /// The part that holds it; itself where it stands by itself.
    holder: u32,
}

impl Part {
    /// Whether it goes on beyond the region.
    fn is_cut(&self) -> bool {
        self.border as f32 > BORDER_SHARE * self.voxels as f32
    }
}

impl Parts {
    /// Of the fused distances `solid` `[resolution^3]`, what lies above the `ground`: only where some
    /// view saw the surface close by, for what nobody saw is solid too. `gaze` is how cameras look at it.
    #[must_use]
    pub(super) fn new(
        solid: &[f32],
        resolution: usize,
        ground: Option<&Plane>,
        gaze: Gaze,
    ) -> Self {
        let on_surface = seen_surface(solid);
        let above = |cell: usize| {
            let p = ProbabilityMap::centre(resolution, cell);
            ground.is_none_or(|plane| !plane.has(p))
        };
        let cells = solid.iter().enumerate();
        let massive: Vec<bool> = cells.map(|(cell, d)| *d < 0.0 && above(cell)).collect();
        let seen = massive
            .iter()
            .zip(solid)
            .map(|(massive, d)| *massive && on_surface(*d));
        let seen: Vec<bool> = seen.collect();
        let (labels, count) = match ground {
            Some(plane) => things(&seen, height_above(plane, resolution), resolution),
            None => components(&seen, |cell| neighbours(cell, resolution)),
        };
        let floor = ground.filter(|plane| plane.is_level(gaze.up));
        Self::of_labels(resolution, massive, labels, count, floor.copied(), gaze)
    }

    fn of_labels(
        resolution: usize,
        solid: Vec<bool>,
        labels: Vec<u32>,
        count: u32,
        floor: Option<Plane>,
        gaze: Gaze,
    ) -> Self {
        let nothing = Part {
            low: Vec3::INFINITY,
            high: Vec3::NEG_INFINITY,
            ..Part::default()
        };
        let alone = |holder| Part {
            holder,
            ..nothing.clone()
        };
        let mut parts: Vec<Part> = (0..=count).map(alone).collect();
        for (cell, &label) in labels.iter().enumerate().filter(|(_, label)| **label != 0) {
            let p = ProbabilityMap::centre(resolution, cell);
            let part = &mut parts[label as usize];
            part.voxels += 1;
            part.border += usize::from(at_border(p));
            part.central += gaze.central(p);
            part.low = part.low.min(p);
            part.high = part.high.max(p);
        }
        if let Some(plane) = &floor {
            // A crumb of a stem holds nothing, nor does what goes on beyond the region: a wall, a shelf.
            let may_hold = |label: u32| {
                let part = &parts[label as usize];
                part.voxels >= LEAST_VOXELS && !part.is_cut()
            };
            let height = height_above(plane, resolution);
            let holders = holders(&labels, count, may_hold, height, resolution);
            for (part, holder) in parts.iter_mut().zip(holders) {
                part.holder = holder;
            }
        }
        Self {
            resolution,
            solid,
            labels,
            parts,
            floor,
            gaze,
            barred: vec![false; resolution.pow(3)],
        }
    }

    /// The same parts where no set may have any of the `barred` voxels, `[resolution^3]`, which belong to no part.
    #[must_use]
    pub(super) fn keeping_out(self, barred: Vec<bool>) -> Self {
        Self { barred, ..self }
    }

    /// Whether no set may have a point of the normalised frame.
    #[must_use]
    pub(super) fn keeps_out(&self, point: Vec3) -> bool {
        voxel(point, self.resolution).is_some_and(|cell| self.barred[cell])
    }

    /// The same with the parts in `set` fallen apart into their [`cores`], of which `layers` of voxels were taken off.
    #[must_use]
    pub(super) fn split(&self, set: &PartSet, layers: usize) -> Self {
        let of_set = |cell: usize| set.holds(cell) && self.labels[cell] != 0;
        let (cores, count) = cores(&self.solid, of_set, self.resolution, layers);
        let first = self.parts.len() as u32 - 1;
        let labels = self
            .labels
            .iter()
            .zip(cores)
            .map(|(label, core)| match core {
                0 => *label,
                core => first + core,
            });
        Self::of_labels(
            self.resolution,
            self.solid.clone(),
            labels.collect(),
            first + count,
            self.floor,
            self.gaze,
        )
        .keeping_out(self.barred.clone())
    }

    /// How many parts there are, crumbs left out.
    #[must_use]
    pub fn count(&self) -> usize {
        self.parts
            .iter()
            .filter(|part| part.voxels >= LEAST_VOXELS)
            .count()
    }

    /// The largest part near the middle, as the `Gaze` has it, that ends within the region.
    #[must_use]
    pub fn most_central(&self) -> Option<PartSet> {
        let score = |part: &Part| part.central * if part.is_cut() { CUT_OFF } else { 1.0 };
        (1..self.parts.len())
            .filter(|&i| self.parts[i].voxels >= LEAST_VOXELS)
            .max_by(|&a, &b| score(&self.parts[a]).total_cmp(&score(&self.parts[b])))
            .map(|chosen| self.with_neighbours(chosen))
    }

    /// All parts but crumbs.
    #[must_use]
    pub fn all_large(&self) -> Option<PartSet> {
        let chosen: Vec<usize> = (1..self.parts.len())
            .filter(|&i| self.parts[i].voxels >= LEAST_VOXELS)
            .collect();
        (!chosen.is_empty()).then(|| self.set(&chosen))
    }

    /// The part nearest to `point`, within a few voxels.
    #[must_use]
    pub fn at(&self, point: Vec3) -> Option<PartSet> {
        let n = self.resolution;
        let near = 3.0 * 2.0 / n as f32;
        let mut best: Option<(f32, u32)> = None;
        for (cell, &label) in self.labels.iter().enumerate() {
            if label == 0 || self.parts[label as usize].voxels < LEAST_VOXELS {
                continue;
            }
            let distance = ProbabilityMap::centre(n, cell).distance(point);
            if distance < near.max(0.08) && best.is_none_or(|(least, _)| distance < least) {
                best = Some((distance, label));
            }
        }
        best.map(|(_, label)| self.with_neighbours(label as usize))
    }

    /// The chosen part with what holds it or is held by the same, and smaller ones close by that do not stand beside it: thin things come
    /// apart.
    fn with_neighbours(&self, chosen: usize) -> PartSet {
        let whole = self.with_held(chosen);
        let voxels: usize = whole.iter().map(|&i| self.parts[i].voxels).sum();
        let is_beside = |part: &Part, main: &Part| {
            let (low, high) = (main.low - REACH, main.high + REACH);
            part.low.cmpge(low).all() && part.high.cmple(high).all()
        };
        let of = |is_wanted: &dyn Fn(usize) -> bool| -> Vec<usize> {
            let cells = 0..self.labels.len();
            let is_of =
                |cell: &usize| self.labels[*cell] != 0 && is_wanted(self.labels[*cell] as usize);
            cells.filter(is_of).collect()
        };
        let thing = of(&|label| whole.contains(&label));
        let stands_beside = |i: usize| {
            let beside =
                |floor| stands_beside(&of(&|label| label == i), &thing, floor, self.resolution);
            self.floor.as_ref().is_some_and(beside)
        };
        let belongs = |&i: &usize| {
            let part = &self.parts[i];
            let near = || whole.iter().any(|&main| is_beside(part, &self.parts[main]));
            let is_small_piece = !part.is_cut() && part.voxels as f32 > CRUMB * voxels as f32;
            whole.contains(&i) || (is_small_piece && near() && !stands_beside(i))
        };
        let all: Vec<usize> = (1..self.parts.len()).filter(belongs).collect();
        self.set(&all)
    }

    /// The chosen part, what holds it, and what that holds besides.
    fn with_held(&self, chosen: usize) -> Vec<usize> {
        let holder = self.parts[chosen].holder;
        let least = HELD * self.parts[holder as usize].voxels as f32;
        let is_held =
            |part: &Part| part.holder == holder && !part.is_cut() && part.voxels as f32 > least;
        (1..self.parts.len())
            .filter(|&i| i == chosen || is_held(&self.parts[i]))
            .collect()
    }

    /// The voxels of some parts and those next to them that belong to no other.
    fn set(&self, chosen: &[usize]) -> PartSet {
        let mut wanted = vec![false; self.parts.len()];
        for &i in chosen {
            wanted[i] = true;
        }
        PartSet::of_labels(self.resolution, |cell| match self.labels[cell] {
            0 => self.barred[cell].then_some(false),
            label => Some(wanted[label as usize]),
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    const N: usize = 48;
    const FROM_AROUND: Gaze = Gaze {
        up: Vec3::Z,
        along: None,
    };
    const AT_A_WALL: Gaze = Gaze {
        up: Vec3::Y,
        along: None,
    };

    /// Shells of balls (centre, radius), nothing known within them.
    fn shells(balls: &[(Vec3, f32)]) -> Vec<f32> {
        (0..N.pow(3))
            .map(|cell| {
                let p = ProbabilityMap::centre(N, cell);
                let d = balls
                    .iter()
                    .map(|(centre, radius)| p.distance(*centre) - radius)
                    .fold(f32::INFINITY, f32::min);
                d.clamp(-0.16, 0.16)
            })
            .collect()
    }

    #[test]
    fn the_central_part_is_chosen_and_others_on_request() {
        let (near, far) = (Vec3::new(0.1, 0.0, 0.0), Vec3::new(0.6, 0.6, 0.1));
        let solid = shells(&[(near, 0.3), (far, 0.25)]);
        let parts = Parts::new(&solid, N, None, FROM_AROUND);
        assert_eq!(parts.count(), 2);
        let on = |centre: Vec3, radius: f32| centre + Vec3::X * (radius - 0.03);
        let central = parts.most_central().unwrap();
        assert!(central.contains(on(near, 0.3)) && !central.contains(on(far, 0.25)));
        let clicked = parts.at(on(far, 0.25)).unwrap();
        assert!(clicked.contains(on(far, 0.25)) && !clicked.contains(on(near, 0.3)));
        assert!(parts.at(Vec3::new(-0.8, -0.8, -0.8)).is_none());
        let both = parts.all_large().unwrap();
        assert!(both.contains(on(far, 0.25)) && both.contains(on(near, 0.3)));
    }

    #[test]
    fn what_stands_on_a_plane_is_cut_off_it() {
        let plane = Plane {
            normal: Vec3::Z,
            offset: -0.2,
            thickness: 0.03,
        };
        let table = shells(&[(Vec3::new(0.0, 0.0, -9.2), 9.0), (Vec3::ZERO, 0.3)]);
        assert_eq!(Parts::new(&table, N, None, FROM_AROUND).count(), 1);
        let parts = Parts::new(&table, N, Some(&plane), FROM_AROUND);
        let found = parts.most_central().unwrap();
        assert!(found.contains(Vec3::new(0.0, 0.0, 0.27)));
        assert!(!found.contains(Vec3::new(0.7, 0.0, -0.22)));
    }

    #[test]
    fn what_hangs_above_a_part_belongs_to_it() {
        let plane = Plane {
            normal: Vec3::Z,
            offset: -0.6,
            thickness: 0.03,
        };
        let (body, head) = (Vec3::new(0.0, 0.0, -0.35), Vec3::new(0.25, 0.0, 0.2));
        let solid = shells(&[(body, 0.3), (head, 0.2)]);
        let both = |set: &PartSet| {
            set.contains(body + Vec3::Z * 0.27) && set.contains(head + Vec3::Z * 0.17)
        };
        let parts = Parts::new(&solid, N, Some(&plane), FROM_AROUND);
        assert!(both(&parts.most_central().unwrap()));
        assert!(both(&parts.at(head + Vec3::Z * 0.17).unwrap()));
        // Above nothing, and before a wall, it is another thing.
        for (ground, gaze) in [(None, FROM_AROUND), (Some(&plane), AT_A_WALL)] {
            let parts = Parts::new(&solid, N, ground, gaze);
            assert!(!both(&parts.most_central().unwrap()));
        }
    }

    #[test]
    fn what_goes_on_beyond_the_region_is_told_with_the_side() {
        let found = |centre: Vec3| {
            Parts::new(&shells(&[(centre, 0.5)]), N, None, FROM_AROUND).most_central()
        };
        assert_eq!(found(Vec3::ZERO).unwrap().goes_on(), None);
        let cut = found(Vec3::new(0.8, -0.1, -0.7)).unwrap();
        assert_eq!(cut.goes_on(), Some(Vec3::new(1.0, 0.0, -1.0)));
        assert!(cut.border_share() > BORDER_SHARE);
    }

    #[test]
    fn a_tip_that_goes_on_beyond_the_region_is_told_from_more_of_it() {
        let tip =
            Parts::new(&shells(&[(Vec3::X * 0.49, 0.5)]), N, None, FROM_AROUND).most_central();
        let tip = tip.unwrap();
        assert_eq!(tip.goes_on(), None);
        assert_eq!(tip.reaches_on(), Some(Vec3::X));
        let within =
            Parts::new(&shells(&[(Vec3::X * 0.4, 0.5)]), N, None, FROM_AROUND).most_central();
        assert_eq!(within.unwrap().reaches_on(), None);
    }

    #[test]
    fn what_hangs_together_with_something_beyond_the_region_can_be_parted() {
        let (central, beyond) = (Vec3::new(-0.15, 0.0, 0.0), Vec3::new(0.85, 0.1, 0.0));
        let on_central = central - Vec3::X * 0.27;
        let mut solid = shells(&[(central, 0.3), (beyond, 0.35)]);
        // A streak from one to the other, three voxels thick.
        for (cell, distance) in solid.iter_mut().enumerate() {
            let p = ProbabilityMap::centre(N, cell);
            if (0.0..0.7).contains(&p.x) {
                *distance = distance.min(p.y.hypot(p.z) - 0.06);
            }
        }
        let parts = Parts::new(&solid, N, None, FROM_AROUND);
        assert_eq!(parts.count(), 1);
        let both = parts.most_central().unwrap();
        assert!(both.contains(on_central) && both.goes_on().is_some());
        let split = parts.split(&both, 2);
        let found = split.most_central().unwrap();
        assert!(found.contains(on_central) && !found.contains(beyond - Vec3::X * 0.33));
        assert_eq!(found.goes_on(), None);
        let [core, whole] = [&found, &both].map(|set| FROM_AROUND.central_of(set));
        assert!(core > 0.5 * whole);
        let clicked = split.at(on_central).unwrap();
        assert!(clicked.contains(on_central) && clicked.goes_on().is_none());
    }

    #[test]
    fn nothing_is_found_in_nothing() {
        let parts = Parts::new(&vec![1.0; N.pow(3)], N, None, FROM_AROUND);
        assert!(parts.most_central().is_none() && parts.all_large().is_none());
    }
}
