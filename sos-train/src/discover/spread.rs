//! From what is known of some of a surface, as by the masks of a few views, to all that is the object: labels spread over it.
//!
//! What a masked view shows is the object's or is not. What none of them shows is like what it hangs together with in the
//! same colours ([`network`](super::network)), and like what its own colour mostly is ([`likelihood`](crate::likelihood)).

use glam::Vec3;
use rayon::prelude::*;

use super::judge::{Judge, Saying};
use super::masks;
use super::network::Network;
use super::part_set::{PartSet, voxel};
use crate::likelihood::Colours;
use crate::prepare::Prepared;
use crate::prepare::mask::Mask;
use crate::train::carve::depth::DepthPicture;
use crate::voxels::{components, neighbours};

/// How a voxel holds to what is said of it, to how often its colour is the object's, and to not being the
/// object where a mask has no white in front of it, all over how it holds to a neighbour of its colour.
const HOLD_SEEN: f32 = 10.0;
const HOLD_COLOUR: f32 = 0.02;
const HOLD_ASIDE: f32 = 0.1;
/// How badly creases conduct where what is known may be far away.
pub(super) const CREASES: f32 = 4.0;
/// Where nothing is known a voxel holds to nothing, but labels have to be somewhere where that is so all around.
const LEAST_HOLD: f32 = 1e-6;
/// Of what is known of the object, the share that a set of voxels must have that hangs together with nothing else.
const CRUMB: f32 = 0.005;

/// A voxel of the surface.
#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    points: f32,
    colour: Vec3,
    inside: f32,
    outside: f32,
    aside: f32,
}

/// The voxels of the surface in `depths` that are the object, by the `masks` of a few views; see [`spread`].
pub(super) fn spread_masks(
    masks: &[(usize, Mask)],
    data: &Prepared,
    depths: &[DepthPicture],
    solid: &[f32],
) -> Option<PartSet> {
    let judges: Vec<Judge> = masks
        .iter()
        .map(|(view, mask)| Judge::new(*view, mask, &depths[*view], data))
        .collect();
    spread(data, depths, solid, CREASES, |point| {
        let mut all = Saying::default();
        for judge in &judges {
            let says = judge.of(point);
            all.inside += says.inside;
            all.outside += says.outside;
            all.aside |= says.aside;
        }
        all
    })
}

/// The voxels of the surface in `depths` that are the object, by what is `said` of its points, of most of them perhaps nothing; `None`
/// where none is. `solid` are the fused distances, on as many voxels as the map of `data` has; how badly `creases` conduct is
/// told in [`Network::new`].
pub(super) fn spread(
    data: &Prepared,
    depths: &[DepthPicture],
    solid: &[f32],
    creases: f32,
    said: impl Fn(Vec3) -> Saying + Sync,
) -> Option<PartSet> {
    let resolution = data.map.resolution();
    let (places, cells) = surface(data, depths, resolution, said);
    let known = |cell: &Cell| [cell.outside, cell.inside].map(|sure| sure / cell.points);
    let likelihood = Colours::new(cells.iter().map(|cell| (cell.colour, known(cell))));
    let colours: Vec<Vec3> = cells.iter().map(|cell| cell.colour).collect();
    let network = Network::new(&places, &colours, solid, resolution, creases);
    let (held, target): (Vec<f32>, Vec<f32>) = cells
        .iter()
        .map(|cell| {
            let said = cell.inside + cell.outside;
            let seen = HOLD_SEEN * said / cell.points;
            let aside = HOLD_ASIDE * cell.aside / cell.points;
            let (likely, telling) = likelihood.object(cell.colour);
            let coloured = HOLD_COLOUR * telling;
            let held = seen + aside + coloured + LEAST_HOLD;
            let sum = seen * cell.inside / said.max(1e-9) + coloured * likely;
            (held, sum / held)
        })
        .unzip();
    let labels = network.solve(&held, &target);
    let is_object = borne_out(&places, &cells, &labels, resolution);
    let found = is_object.contains(&true);
    found.then(|| PartSet::of_surface(resolution, places.into_iter().zip(is_object)))
}

/// Which voxels are the object: those of sets that hang together and of which more than a crumb is known.
fn borne_out(places: &[usize], cells: &[Cell], labels: &[f32], resolution: usize) -> Vec<bool> {
    let mut inside = vec![false; resolution.pow(3)];
    for (place, label) in places.iter().zip(labels) {
        inside[*place] = *label > 0.5;
    }
    let (sets, count) = components(&inside, |cell| neighbours(cell, resolution));
    let mut shown = vec![0.0; count as usize + 1];
    for (place, cell) in places.iter().zip(cells) {
        shown[sets[*place] as usize] += cell.inside;
    }
    shown[0] = 0.0;
    let least = CRUMB * shown.iter().sum::<f32>();
    let sets = places.iter().map(|place| sets[*place] as usize);
    sets.map(|set| set != 0 && shown[set] > least).collect()
}

/// The voxels that views show a point in, and what is known of them.
fn surface(
    data: &Prepared,
    depths: &[DepthPicture],
    resolution: usize,
    said: impl Fn(Vec3) -> Saying + Sync,
) -> (Vec<usize>, Vec<Cell>) {
    let shown: Vec<Vec<(usize, Vec3, Saying)>> = data
        .views
        .par_iter()
        .zip(depths)
        .map(|(view, depth)| {
            masks::points(view, &data.frame, depth)
                .filter_map(|(pixel, point)| {
                    let place = voxel(point, resolution)?;
                    let (x, y) = (pixel.x as u32, pixel.y as u32);
                    if view.ignores(x, y) {
                        return None;
                    }
                    let colour = view.photo.get_pixel(x, y);
                    let colour = Vec3::from(colour.0.map(f32::from)) / 255.0;
                    Some((place, colour, said(point)))
                })
                .collect()
        })
        .collect();
    let mut number = vec![u32::MAX; resolution.pow(3)];
    let (mut places, mut cells) = (Vec::new(), Vec::<Cell>::new());
    for (place, colour, says) in shown.into_iter().flatten() {
        if number[place] == u32::MAX {
            number[place] = cells.len() as u32;
            places.push(place);
            cells.push(Cell::default());
        }
        let cell = &mut cells[number[place] as usize];
        cell.points += 1.0;
        cell.colour += colour;
        cell.inside += says.inside;
        cell.outside += says.outside;
        cell.aside += f32::from(u8::from(says.aside));
    }
    for cell in &mut cells {
        cell.colour /= cell.points;
    }
    (places, cells)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_hangs_together_with_nothing_that_masks_show_is_left_out() {
        let n = 12;
        let at = |x: usize| 12 * 12 * 5 + 12 * 5 + x;
        // Two voxels that are shown, two that are not, and one of another label between them.
        let places = [at(2), at(3), at(5), at(7), at(8)];
        let labels = [0.9, 0.8, 0.2, 0.9, 0.9];
        let mut cells = [Cell {
            points: 1.0,
            ..Cell::default()
        }; 5];
        cells[0].inside = 1.0;
        let is_object = borne_out(&places, &cells, &labels, n);
        assert_eq!(is_object, [true, true, false, false, false]);
        cells[4].inside = 0.5;
        let is_object = borne_out(&places, &cells, &labels, n);
        assert_eq!(is_object, [true, true, false, true, true]);
        cells[4].inside = 0.001;
        assert!(!borne_out(&places, &cells, &labels, n)[4]);
    }
}
