//! Openings that masks fill in.
//!
//! Segmenters close the handle of a can and the gap between two legs. What shows there lies behind all that is around it,
//! and hangs on nothing else that the mask takes in: such a pixel is no witness, and whether the place is the object's is
//! for those to say that see it beside the object. From one side alone nobody else may see it at all; then it goes with what is
//! around it.

use super::depth::{DepthPicture, depth_picture};
use super::silence;
use crate::cells::{neighbours, pieces};
use crate::prepare::spans::PixelSpans;
use crate::prepare::{Prepared, TrainView};
use crate::render::rays::FrozenScene;
use crate::train::Trainer;

/// Rays inside masks whose depths are looked at ([`rays_of`](super::rays_of)).
const RAYS: (usize, usize) = (12_000, 600_000);
/// Neighbours in the raster whose distances differ by more are not of one surface; normalised frame.
const STEP: f32 = 0.06;
/// Share of a piece's border along which it must lie behind what is next to it, inside the mask.
const ENCLOSED: f32 = 0.8;
/// What shows through an opening has at most this share of the mask's largest piece: that is the object.
const LARGEST: f32 = 0.3;
/// Points of the raster that it has at least: single rays slip through a surface.
const SMALLEST: usize = 6;

impl Trainer {
    /// Takes the vote from pixels that look through openings which their masks fill in. Returns what was done, for people;
    /// `None` if nothing.
    pub(super) fn find_openings(
        &mut self,
        scene: &FrozenScene,
        data: &mut Prepared,
    ) -> Option<String> {
        self.mask_faults.openings = openings(scene, data);
        let (masks, all, percent) = silence(data, &self.mask_faults.openings)?;
        Some(format!(
            "{masks} of {all} masks seem to fill in openings, {percent:.1} % of what they cover: what shows there has no vote"
        ))
    }
}

/// The pixels of each view that look through an opening.
fn openings(scene: &FrozenScene, data: &Prepared) -> Vec<PixelSpans> {
    let rays = super::rays_of(data, RAYS) as f32;
    let stride = (super::covered(data) as f32 / rays).sqrt().ceil().max(1.0) as u32;
    let views = data.views.iter().zip(&data.trust.0);
    views
        .map(|(view, trust)| {
            let believed = *trust >= 0.5;
            let opening = believed.then(|| opening(scene, view, data, stride));
            opening.flatten().unwrap_or_default()
        })
        .collect()
}

/// The same for one view; `None` without a mask.
fn opening(
    scene: &FrozenScene,
    view: &TrainView,
    data: &Prepared,
    stride: u32,
) -> Option<PixelSpans> {
    let mask = view.mask.as_ref()?;
    let (width, height) = (view.width(), view.height());
    let raster = DepthPicture {
        stride,
        width: width.div_ceil(stride),
        distances: Vec::new(),
    };
    let in_mask = |i: usize| {
        let pixel = raster.pixel(i).as_uvec2();
        mask.contains(pixel.x.min(width - 1), pixel.y.min(height - 1))
    };
    let picture = depth_picture(scene, view, &data.frame, stride, in_mask);
    let open = enclosed(&picture.distances, picture.width as usize);
    let mut pixels = PixelSpans::default();
    for (x, y) in mask.pixels() {
        if open[(y / stride * picture.width + x / stride) as usize] {
            pixels.push(y * width + x);
        }
    }
    Some(pixels)
}

/// Which points of a raster, row-major, are of a surface that lies behind all that is around it: behind the rest of
/// the mask, which is where there are distances.
fn enclosed(distances: &[f32], width: usize) -> Vec<bool> {
    let pieces = &Pieces::of(distances, width);
    let largest = pieces.members.iter().map(Vec::len).max().unwrap_or(0);
    let mut enclosed = vec![false; distances.len()];
    for members in &pieces.members {
        let size = members.len();
        if size < SMALLEST || size as f32 > LARGEST * largest as f32 {
            continue;
        }
        let borders = members.iter().flat_map(|&i| {
            let beyond = neighbours(i, width, distances.len());
            let beyond = beyond.filter(move |j| j.is_none_or(|j| !pieces.same(i, j)));
            beyond.map(move |j| j.is_some_and(|j| distances[i] > distances[j] + STEP))
        });
        let (border, behind) = borders.fold((0, 0), |(border, behind), is_behind| {
            (border + 1, behind + u32::from(is_behind))
        });
        if behind as f32 >= ENCLOSED * border as f32 {
            for &i in members {
                enclosed[i] = true;
            }
        }
    }
    enclosed
}

/// Connected surfaces in a raster of distances.
struct Pieces {
    /// The points of each piece.
    members: Vec<Vec<usize>>,
    /// The piece of each point; `None` where there is no distance.
    of_point: Vec<Option<usize>>,
}

impl Pieces {
    fn of(distances: &[f32], width: usize) -> Self {
        let joined = |i: usize, j: usize| {
            // Beyond the box all is one: infinitely far.
            (distances[i] - distances[j]).abs() <= STEP || distances[i] == distances[j]
        };
        let members = pieces(distances.len(), width, |i| !distances[i].is_nan(), joined);
        let mut of_point = vec![None; distances.len()];
        for (piece, members) in members.iter().enumerate() {
            for &i in members {
                of_point[i] = Some(piece);
            }
        }
        Self { members, of_point }
    }

    fn same(&self, i: usize, j: usize) -> bool {
        self.of_point[i] == self.of_point[j]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mask of 24x16 points a margin inside a raster of 30x20, at distance 2, with pieces of other distances.
    fn raster(pieces: &[([usize; 4], f32)]) -> Vec<f32> {
        let mut distances = vec![f32::NAN; 30 * 20];
        let all = [([3, 2, 27, 18], 2.0)];
        for ([x0, y0, x1, y1], distance) in all.iter().chain(pieces) {
            for y in *y0..*y1 {
                distances[y * 30 + x0..y * 30 + x1].fill(*distance);
            }
        }
        distances
    }

    fn found(pieces: &[([usize; 4], f32)]) -> usize {
        let open = enclosed(&raster(pieces), 30);
        open.iter().filter(|open| **open).count()
    }

    #[test]
    fn what_lies_behind_all_around_it_shows_through_an_opening() {
        assert_eq!(found(&[([10, 5, 15, 9], 2.5)]), 20);
        // So far that there is nothing in the box.
        assert_eq!(found(&[([10, 5, 15, 9], f32::INFINITY)]), 20);
    }

    #[test]
    fn what_stands_before_or_hangs_on_the_object_is_no_opening() {
        assert_eq!(found(&[]), 0);
        assert_eq!(found(&[([10, 5, 15, 9], 1.5)]), 0);
        assert_eq!(found(&[([10, 5, 15, 9], 2.05)]), 0);
        // A bowl's inside hangs on its far rim.
        let bowl: Vec<_> = (0..8)
            .map(|row| ([10, 5 + row, 20, 6 + row], 2.0 + 0.04 * row as f32))
            .collect();
        assert_eq!(found(&bowl), 0);
        // Behind, but as large as the object, at the mask's border, or a single ray.
        assert_eq!(found(&[([5, 3, 25, 16], 2.5)]), 0);
        assert_eq!(found(&[([3, 5, 7, 9], 2.5)]), 0);
        assert_eq!(found(&[([10, 5, 11, 6], 2.5)]), 0);
    }
}
