//! Where the masks can be relied on, measured by the surface that all of them agreed on.
//!
//! Rough masks are wrong in different places in different views: FoCoR, carved out of the scene by
//! what most views say, contradicts them, and must not be pulled back. Good masks differ from it by
//! a pixel or two, and know better than colours do where white fur ends before a white wall. Many are
//! both: exact along most of the outline, and plainly wrong where a neighbour is included or a part is
//! lost. So a mask's say late in training follows, tile by tile of the picture, from how far it and
//! FoCoR's matte agree there.
//!
//! A matte that follows a mask comes to agree with it, however wrong the mask is. So every fourth tile is
//! not followed, another one in each view, and by those alone it is said how exact masks are: exact masks
//! move the surface to where the others, too, see it end; rough ones do not.
//!
//! Where the surface itself is too large, as before a dark ground that could as well be the object's, masks
//! may be better than all of it. Those that are show in their photos: their outlines lie on edges.

use rayon::prelude::*;

use super::Trainer;
use crate::median::median;
use crate::prepare::Prepared;
use crate::prepare::edge_contrast::edge_contrast;

/// Tiles along the longer side of a picture.
const TILES: u32 = 24;
/// Share of a tile's rays on which mask and matte may differ for full trust, and from which on there is
/// none. An outline that is off by `d` pixels costs `d / side` of its tile.
const NEAR: f32 = 0.08;
const FAR: f32 = 0.18;
/// The same for an outline that is exact, to a pixel or so.
const EXACT: f32 = 0.05;
/// Shares of the outline's tiles that are exact, from which a mask is trusted at all, and fully: where
/// most of an outline is rough, a tile that happens to agree is no better. Of rough masks' tiles three in ten
/// do (docs/decisions/masks.md).
const LEAST_EXACT: f32 = 0.3;
const MOSTLY_EXACT: f32 = 0.38;
/// How much stronger the photo's edges have to be along a mask's outline than beside it
/// ([`edge_contrast`](crate::prepare::edge_contrast)) for any trust, and for full. Rough masks have up to 2, exact ones
/// 2 to 5 (docs/decisions/masks.md).
const LEAST_CONTRAST: f32 = 2.5;
const FULL_CONTRAST: f32 = 3.2;
/// Up to this in the middle view no mask is trusted for its photo: one that happens to lie on edges is no better than
/// the others.
const MOSTLY_ROUGH: f32 = 2.2;
/// Rays below which nothing is known about a tile.
const LEAST_RAYS: f32 = 6.0;
/// A tile holds outline where this share of it at least is object, and likewise not.
const BOTH: f32 = 0.05;
/// Rays below which it is not said whether a tile is exact: of ten rays of a tile that is off by a tenth, none
/// differs in one case of three.
const SURE_RAYS: f32 = 40.0;
/// What older rays count after each update, where there are more than enough of them.
const KEPT: f32 = 0.7;
const ENOUGH_RAYS: f32 = 1.5 * SURE_RAYS;

/// One in so many tiles is not followed.
const CONTROL: usize = 4;

/// Whether a view's tile only tells how exact masks are.
fn is_control(view: usize, tile: usize) -> bool {
    let (x, y) = (tile % TILES as usize, tile / TILES as usize);
    (x + y + view).is_multiple_of(CONTROL)
}

/// The tile of a view's pixel, below [`tiles`]: a square grid, of which the shorter side of a picture uses
/// a part.
#[must_use]
pub fn tile_of((width, height): (u32, u32), x: u32, y: u32) -> u32 {
    let side = width.max(height).max(1);
    let along = |v: u32| (u64::from(v) * u64::from(TILES) / u64::from(side)) as u32;
    along(y).min(TILES - 1) * TILES + along(x).min(TILES - 1)
}

/// Number of tiles of a view.
#[must_use]
pub fn tiles() -> usize {
    (TILES * TILES) as usize
}

/// Rays of one tile.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Tile {
    rays: f32,
    /// Of them, what mask and matte say of the object, and where they differ.
    mask: f32,
    matte: f32,
    differ: f32,
    /// The conclusion, 0 to 1.
    trust: f32,
}

impl Tile {
    /// The share of rays on which mask and matte differ; `None` where too little is known.
    fn difference(&self) -> Option<f32> {
        (self.rays >= LEAST_RAYS).then(|| self.differ / self.rays)
    }

    /// Has rays so far count less, but for what is needed to say anything: where there are many views, a tile
    /// gets few at a time.
    fn fade(&mut self) {
        if self.rays < ENOUGH_RAYS {
            return;
        }
        let Self {
            rays,
            mask,
            matte,
            differ,
            trust: _,
        } = self;
        for sum in [rays, mask, matte, differ] {
            *sum *= KEPT;
        }
    }

    /// Whether an outline, the mask's or the matte's, runs through it.
    fn has_outline(&self) -> bool {
        let mixed = |part: f32| (BOTH..1.0 - BOTH).contains(&(part / self.rays));
        mixed(self.mask) || mixed(self.matte) || mixed(self.differ)
    }
}

/// How far mask and matte agree, tile by tile of every view.
#[derive(Clone, Debug, PartialEq)]
pub struct Agreement {
    /// `[views * tiles]`.
    tiles: Vec<Tile>,
}

impl Agreement {
    /// Nothing known: no mask is trusted.
    #[must_use]
    pub fn new(views: usize) -> Self {
        Self {
            tiles: vec![Tile::default(); views * tiles()],
        }
    }

    /// Number of views.
    #[must_use]
    pub fn views(&self) -> usize {
        self.tiles.len() / tiles()
    }

    /// A ray through `tile` of `view` whose own mask says `object` and whose matte is `matte`.
    pub fn add(&mut self, view: usize, tile: u32, matte: f32, object: bool) {
        let mask = f32::from(u8::from(object));
        let tile = &mut self.tiles[view * tiles() + tile as usize];
        tile.rays += 1.0;
        tile.mask += mask;
        tile.matte += matte;
        // A soft edge is no difference: masks are hard.
        tile.differ += f32::from(u8::from(object != (matte > 0.5)));
    }

    /// Draws conclusions from the rays so far, and has them count less from now on. `contrasts` are those of the
    /// views' masks with the photos, where they are known.
    pub fn update(&mut self, contrasts: &[Option<f32>]) {
        let views = || self.tiles.chunks(tiles()).enumerate();
        // No more than all views together: among masks that are rough on the whole, one that happens to
        // agree better is not more exact.
        let control = views().flat_map(|(view, tiles)| {
            let tiles = tiles.iter().enumerate();
            tiles.filter_map(move |(i, tile)| is_control(view, i).then_some(tile))
        });
        let all = exact_share(control).unwrap_or(0.0);
        let middle = middle(contrasts);
        let exact: Vec<Option<f32>> = views().map(|(_, tiles)| exact_share(tiles)).collect();
        for (number, (tiles, exact)) in self.tiles.chunks_mut(tiles()).zip(exact).enumerate() {
            let view = exact.map_or(0.0, |share| ramp(share.min(all), LEAST_EXACT, MOSTLY_EXACT));
            // The photo says so, whatever the surface does: that needs no tiles to be left alone.
            let contrast = contrasts.get(number).copied().flatten().zip(middle);
            let by_photo = contrast.map_or(0.0, |(own, middle)| {
                trust_by_photo(own) * ramp(middle, MOSTLY_ROUGH, LEAST_CONTRAST)
            });
            for (i, tile) in tiles.iter_mut().enumerate() {
                let by_surface = if is_control(number, i) { 0.0 } else { view };
                let mask = by_surface.max(by_photo);
                tile.trust = tile
                    .difference()
                    .map_or(0.0, |differ| mask * ramp(differ, FAR, NEAR));
                tile.fade();
            }
        }
    }

    /// Trust in the mask of `view` in `tile`, 0 to 1.
    #[must_use]
    pub fn trust(&self, view: usize, tile: u32) -> f32 {
        self.tiles[view * tiles() + tile as usize].trust
    }

    /// Everything as one list, for a checkpoint: five numbers a tile.
    #[must_use]
    pub fn values(&self) -> Vec<f32> {
        let tiles = self.tiles.iter();
        tiles
            .flat_map(|t| [t.rays, t.mask, t.matte, t.differ, t.trust])
            .collect()
    }

    /// Takes over what [`values`](Self::values) gave; `None` when it is of another number of views.
    #[must_use]
    pub fn from_values(views: usize, values: &[f32]) -> Option<Self> {
        (values.len() == 5 * views * tiles()).then(|| Self {
            tiles: values
                .chunks_exact(5)
                .map(|v| Tile {
                    rays: v[0],
                    mask: v[1],
                    matte: v[2],
                    differ: v[3],
                    trust: v[4],
                })
                .collect(),
        })
    }
}

/// Of the tiles with outline, the share in which mask and matte agree to a pixel or so; `None`
/// without any such tile.
fn exact_share<'a>(tiles: impl IntoIterator<Item = &'a Tile>) -> Option<f32> {
    let outline = tiles
        .into_iter()
        .filter(|tile| tile.rays >= SURE_RAYS && tile.has_outline())
        .filter_map(Tile::difference);
    let (mut all, mut exact) = (0.0, 0.0);
    for difference in outline {
        all += 1.0;
        exact += f32::from(u8::from(difference <= EXACT));
    }
    (all > 0.0).then(|| exact / all)
}

/// The middle one of those that are known.
fn middle(contrasts: &[Option<f32>]) -> Option<f32> {
    let mut known: Vec<f32> = contrasts.iter().flatten().copied().collect();
    median(&mut known)
}

/// How far a mask is trusted for its contrast with the photo.
fn trust_by_photo(contrast: f32) -> f32 {
    ramp(contrast, LEAST_CONTRAST, FULL_CONTRAST)
}

impl Trainer {
    /// Has no mask of the `views`, so many in number, followed to the pixel: for masks that were found in the photos
    /// themselves, whose outlines lie on edges without anybody having drawn them there.
    pub fn take_masks_for_rough(&mut self, views: usize) {
        self.mask_contrasts = vec![None; views];
    }

    /// Finds out which masks' outlines lie on edges of their photos, if nobody has yet.
    pub(super) fn look_at_outlines(&mut self, data: &Prepared) {
        if self.mask_contrasts.is_empty() {
            self.mask_contrasts = data.views.par_iter().map(edge_contrast).collect();
        }
    }

    /// Just before the carving, what the photos' edges tell of the masks, for people; `None` where there are no
    /// masks or none will be followed.
    pub fn contrast_note(&mut self, data: &Prepared) -> Option<String> {
        if !self.is_carving_due() || self.config().loss.mask_trusted == 0.0 {
            return None;
        }
        self.look_at_outlines(data);
        let middle = middle(&self.mask_contrasts)?;
        let known = self.mask_contrasts.iter().flatten();
        let (all, exact) = (
            known.clone().count(),
            known.filter(|c| trust_by_photo(**c) > 0.0).count(),
        );
        let what = if middle > MOSTLY_ROUGH {
            "these are followed to the pixel"
        } else {
            "too few to be followed to the pixel, the scene decides where outlines run"
        };
        Some(format!(
            "photos change {middle:.1} times as much along their masks' outlines as beside them, in the middle \
             view; {exact} of {all} masks are exact by that: {what}"
        ))
    }
}

/// 0 at `from`, 1 at `to`, between in between.
fn ramp(value: f32, from: f32, to: f32) -> f32 {
    ((value - from) / (to - from)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A view of 240 x 240 pixels, ten to a tile, whose object is a disc; the mask by its own rule.
    fn look(agreement: &mut Agreement, view: usize, mask: impl Fn(f32, f32) -> bool) {
        for y in 0..240 {
            for x in 0..240 {
                let (u, v) = (x as f32 - 119.5, y as f32 - 119.5);
                let object = f32::from(u8::from(u.hypot(v) < 60.0));
                agreement.add(view, tile_of((240, 240), x, y), object, mask(u, v));
            }
        }
    }

    fn trust(agreement: &Agreement, view: usize, u: i32, v: i32) -> f32 {
        agreement.trust(
            view,
            tile_of((240, 240), (120 + u) as u32, (120 + v) as u32),
        )
    }

    #[test]
    fn an_exact_mask_with_a_leak_is_trusted_but_for_the_leak() {
        let mut agreement = Agreement::new(2);
        for view in 0..2 {
            look(&mut agreement, view, |u, v| {
                u.hypot(v) < 60.0 || (u > 0.0 && v.abs() < 20.0 && u < 100.0)
            });
        }
        assert_eq!(trust(&agreement, 0, -60, 0), 0.0);
        agreement.update(&[]);
        assert_eq!(trust(&agreement, 0, -60, 0), 1.0);
        assert_eq!(trust(&agreement, 0, 80, 10), 0.0);
        // An exact tile that is not followed.
        assert_eq!(trust(&agreement, 0, -60, 20), 0.0);
        assert!(is_control(0, tile_of((240, 240), 60, 140) as usize));
        let back = Agreement::from_values(2, &agreement.values());
        assert_eq!(back, Some(agreement));
        assert_eq!(Agreement::from_values(3, &[0.0; 12]), None);
    }

    #[test]
    fn masks_that_are_too_small_all_around_are_not_trusted_anywhere() {
        let mut agreement = Agreement::new(1);
        look(&mut agreement, 0, |u, v| u.hypot(v) < 55.0);
        agreement.update(&[]);
        for (u, v) in [(-58, 0), (0, 58), (41, 41), (0, 0)] {
            assert_eq!(trust(&agreement, 0, u, v), 0.0, "{u} {v}");
        }
    }

    #[test]
    fn an_outline_that_is_mostly_exact_is_trusted_and_little_of_it_is_chance() {
        for (exact, expected) in [(8, 0.0), (15, 1.0)] {
            let mut agreement = Agreement::new(4);
            for view in 0..4 {
                // Of twenty sectors so many have the outline where it is, the others six pixels off.
                look(&mut agreement, view, |u, v| {
                    let turn = 0.5 + v.atan2(u) / std::f32::consts::TAU;
                    let sector = (20.0 * turn) as i32;
                    let off = match (sector < exact, sector % 2) {
                        (true, _) => 0.0,
                        (false, 0) => 6.0,
                        (false, _) => -6.0,
                    };
                    u.hypot(v) < 60.0 + off
                });
            }
            agreement.update(&[]);
            // The third sector's middle.
            let angle = (2.5 / 20.0 - 0.5) * std::f32::consts::TAU;
            let (u, v) = ((60.0 * angle.cos()) as i32, (60.0 * angle.sin()) as i32);
            assert_eq!(trust(&agreement, 0, u, v), expected, "{exact} of 20");
        }
    }

    #[test]
    fn a_few_rays_do_not_make_a_rough_mask_exact() {
        // One ray of a hundred: of those of a tile that is off by a tenth, often none differs.
        let mut agreement = Agreement::new(4);
        let few = |agreement: &mut Agreement, round: u32| {
            for view in 0..4 {
                for (x, y) in (0..240).flat_map(|x| (0..240).map(move |y| (x, y))) {
                    let (u, v) = (x as f32 - 119.5, y as f32 - 119.5);
                    if (x * 7 + y * 13 + 31 * view as u32 + 17 * round).is_multiple_of(12) {
                        let object = f32::from(u8::from(u.hypot(v) < 60.0));
                        let tile = tile_of((240, 240), x, y);
                        agreement.add(view, tile, object, u.hypot(v) < 58.8);
                    }
                }
            }
        };
        few(&mut agreement, 0);
        agreement.update(&[]);
        let trusted = |agreement: &Agreement| agreement.tiles.iter().any(|tile| tile.trust > 0.0);
        assert!(!trusted(&agreement));
        // They are kept until there are enough, and then say the same as many at once.
        let before: f32 = agreement.tiles.iter().map(|tile| tile.rays).sum();
        for round in 1..8 {
            few(&mut agreement, round);
            agreement.update(&[]);
        }
        let after: f32 = agreement.tiles.iter().map(|tile| tile.rays).sum();
        assert!(after > 4.5 * before, "{before} {after}");
        assert!(exact_share(&agreement.tiles).is_some());
    }

    #[test]
    fn a_good_mask_among_rough_ones_is_not_trusted() {
        let mut agreement = Agreement::new(3);
        look(&mut agreement, 0, |u, v| u.hypot(v) < 60.0);
        look(&mut agreement, 1, |u, v| u.hypot(v) < 54.0);
        look(&mut agreement, 2, |u, v| u.hypot(v) < 66.0);
        agreement.update(&[]);
        assert_eq!(trust(&agreement, 0, -60, 0), 0.0);
    }

    #[test]
    fn masks_on_edges_of_the_photo_are_followed_where_the_surface_is_near() {
        let mut agreement = Agreement::new(3);
        for view in 0..3 {
            // A pixel off all around, and a part is missing.
            look(&mut agreement, view, |u, v| u.hypot(v) < 59.0 && v < 40.0);
        }
        let mut rough = agreement.clone();
        agreement.update(&[Some(4.0), Some(4.0), None]);
        // Most are rough.
        rough.update(&[Some(4.0), Some(2.0), Some(1.0)]);
        for view in 0..3 {
            let near = trust(&agreement, view, -59, 0);
            assert_eq!(near > 0.0, view < 2, "{near}");
            assert_eq!(trust(&agreement, view, 0, 50), 0.0);
            assert_eq!(trust(&rough, view, -59, 0), 0.0);
        }
    }

    #[test]
    fn tiles_are_square_and_cover_every_picture() {
        assert_eq!(tile_of((960, 540), 959, 539), 13 * TILES + TILES - 1);
        assert_eq!(tile_of((540, 960), 539, 959), (TILES - 1) * TILES + 13);
        assert_eq!(tile_of((1, 1), 0, 0), 0);
    }
}
