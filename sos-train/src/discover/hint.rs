//! What the user says about the object when there are no masks, and what follows from it.

use glam::{DVec2, DVec3, Vec2, Vec3};
use io_colmap::SparsePoint;
use scene_decomp::probability::ProbabilityMap;
use serde::{Deserialize, Serialize};

use super::part_set::PartSet;
use super::parts::Parts;
use super::region;
use super::spread::spread_masks;
use crate::prepare::error::PrepareError;
use crate::prepare::mask::Mask;
use crate::prepare::{Frame, Prepared, TrainView};
use crate::train::carve::depth::DepthPicture;

/// How many masks are few, at most, and how many views there must be for each of them.
const FEW: usize = 3;
const VIEWS_EACH: usize = 4;

/// Where the object is.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Hint {
    /// Where the cameras look.
    #[default]
    Nothing,
    /// At a pixel of a photo.
    Click(Click),
    /// In a box of the scene's frame.
    Box(WorldBox),
    /// In the masks of a few views, white is the object, of their photos' sizes, each by the view's number; one at least.
    Masks(Vec<(usize, Mask)>),
}

impl Hint {
    /// What a user says of where the object is; a click before a box.
    #[must_use]
    pub fn stated(click: Option<Click>, object_box: Option<WorldBox>) -> Self {
        match (click, object_box) {
            (Some(click), _) => Self::Click(click),
            (None, Some(object_box)) => Self::Box(object_box),
            (None, None) => Self::Nothing,
        }
    }
}

/// A pixel of a photo.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Click {
    /// The photo's name, or its stem.
    pub view: String,
    /// From the left edge, in pixels of the photo.
    pub x: f64,
    /// From the upper edge.
    pub y: f64,
}

/// A box along the axes of the scene's frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorldBox {
    /// The smallest coordinates.
    pub low: [f64; 3],
    /// The largest.
    pub high: [f64; 3],
}

impl std::str::FromStr for Click {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text:?} is not VIEW:X,Y, as in 0012.jpg:640,360");
        let (view, pixel) = text.rsplit_once(':').ok_or_else(wrong)?;
        let (x, y) = pixel.split_once(',').ok_or_else(wrong)?;
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        match (number(x), number(y)) {
            (Some(x), Some(y)) if !view.is_empty() => Ok(Self {
                view: view.to_owned(),
                x,
                y,
            }),
            _ => Err(wrong()),
        }
    }
}

impl std::str::FromStr for WorldBox {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "{text:?} is not X0,Y0,Z0,X1,Y1,Z1 with each of the first three below its partner"
            )
        };
        let numbers: Vec<f64> = text
            .split(',')
            .map(|part| part.trim().parse::<f64>().ok().filter(|v| v.is_finite()))
            .collect::<Option<_>>()
            .ok_or_else(wrong)?;
        match numbers.as_slice() {
            &[x0, y0, z0, x1, y1, z1] if x0 < x1 && y0 < y1 && z0 < z1 => Ok(Self {
                low: [x0, y0, z0],
                high: [x1, y1, z1],
            }),
            _ => Err(wrong()),
        }
    }
}

impl Click {
    /// The number of the view it is in.
    fn find(&self, views: &[TrainView]) -> Result<usize, PrepareError> {
        let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
        let number = view_called(&self.view, &names)?;
        let (width, height) = (views[number].width(), views[number].height());
        if !(0.0..f64::from(width)).contains(&self.x) || !(0.0..f64::from(height)).contains(&self.y)
        {
            return Err(PrepareError::Scene(format!(
                "--click {}: ({}, {}) is outside the photo of {width} x {height} pixels; count pixels of the photo \
                 itself, from its upper left corner",
                self.view, self.x, self.y
            )));
        }
        Ok(number)
    }
}

/// Which of `names` is meant: by the name in full, or without folders, without ending, or with another one.
fn view_called(given: &str, names: &[&str]) -> Result<usize, PrepareError> {
    let rounds: [&dyn Fn(&str) -> bool; 3] = [
        &|name| name == given,
        &|name| [file(name), stem(name), stem(file(name))].contains(&given),
        &|name| stem(file(name)) == stem(file(given)),
    ];
    for fits in rounds {
        let mut found = (0..names.len()).filter(|&i| fits(names[i]));
        match (found.next(), found.next()) {
            (Some(number), None) => return Ok(number),
            (Some(first), Some(second)) => {
                return Err(PrepareError::Scene(format!(
                    "--click {given}: both {} and {} are called that; give the whole name",
                    names[first], names[second]
                )));
            }
            (None, _) => {}
        }
    }
    Err(PrepareError::Scene(format!(
        "--click {given}: no photo of that name has a pose; names are like {}",
        names.first().unwrap_or(&"001.jpg")
    )))
}

/// A name without its folders.
fn file(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or(name)
}

/// A name without its ending.
fn stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

impl Hint {
    /// The masks of `views` where they are few: too few for what they agree on to have the object's shape.
    #[must_use]
    pub fn of_few_masks(views: &[TrainView]) -> Option<Self> {
        let masked = views.iter().enumerate();
        let masks: Vec<(usize, Mask)> = masked
            .filter_map(|(number, view)| Some((number, view.mask.clone()?)))
            .collect();
        let one = masks.len() == 1;
        let few = masks.len() <= FEW && VIEWS_EACH * masks.len() <= views.len();
        (one || few && !masks.is_empty()).then_some(Self::Masks(masks))
    }

    /// The same for views at `1 / factor` of their width and height.
    #[must_use]
    pub fn downscaled(&self, factor: u32) -> Self {
        let part = 1.0 / f64::from(factor.max(1));
        match self {
            Self::Click(click) => Self::Click(Click {
                view: click.view.clone(),
                x: part * click.x,
                y: part * click.y,
            }),
            other => other.clone(),
        }
    }

    /// The region in which to look for the object.
    ///
    /// # Errors
    /// When cameras and points do not determine one.
    pub(crate) fn region(
        &self,
        views: &[TrainView],
        points: &[SparsePoint],
    ) -> Result<Frame, PrepareError> {
        match self {
            Self::Nothing => region::of_cameras(views, points),
            Self::Box(WorldBox { low, high }) => {
                let (low, high) = (DVec3::from(*low), DVec3::from(*high));
                Ok(Frame {
                    centre: 0.5 * (low + high),
                    half_side: 0.5 * (high - low).max_element(),
                })
            }
            Self::Click(click) => {
                let view = click.find(views)?;
                region::around_click(views, points, view, DVec2::new(click.x, click.y))
            }
            Self::Masks(masks) => {
                let largest = masks.iter().max_by_key(|(_, mask)| mask.area());
                let around = largest.and_then(|(view, mask)| Some((*view, centroid(mask)?)));
                let (view, (centre, radius)) = around.ok_or_else(|| {
                    let names: Vec<&str> = masks.iter().map(|(i, _)| &*views[*i].name).collect();
                    PrepareError::Scene(format!(
                        "the mask of {} is empty, and there is no other; mark the object in it, or add \
                         --masks none to have the object looked for",
                        names.join(", ")
                    ))
                })?;
                region::at_pixel(views, points, view, centre, Some(radius))
            }
        }
    }

    /// Takes out of the fused distances `solid` `[resolution^3]` what lies outside of the box, if there is one: the region is the
    /// cube around it, in which its neighbours may stand.
    pub(super) fn clip(&self, solid: &mut [f32], resolution: usize, frame: &Frame) {
        let Self::Box(WorldBox { low, high }) = self else {
            return;
        };
        // What is at a face of the box is in the voxel that the face goes through.
        let voxel = 2.0 * frame.half_side / resolution as f64;
        let (low, high) = (DVec3::from(*low) - voxel, DVec3::from(*high) + voxel);
        for (cell, distance) in solid.iter_mut().enumerate() {
            let at = frame.world_from_normalised(ProbabilityMap::centre(resolution, cell));
            if at.cmplt(low).any() || at.cmpgt(high).any() {
                *distance = f32::INFINITY;
            }
        }
    }

    /// The object, of `parts` or, by masks, of all that is there, the fused distances `solid`.
    pub(super) fn choose(
        &self,
        parts: &Parts,
        data: &Prepared,
        depths: &[DepthPicture],
        solid: &[f32],
    ) -> Result<PartSet, PrepareError> {
        let nothing = || {
            PrepareError::Scene(
                "without masks the object is what stands in the middle of the cameras' view, but \
                 nothing stands out there; show it with a mask for one photo or more (--masks), with \
                 --click VIEW:X,Y or with --box"
                    .to_owned(),
            )
        };
        match self {
            Self::Nothing => parts.most_central().ok_or_else(nothing),
            Self::Box(_) => parts.all_large().ok_or_else(|| {
                PrepareError::Scene(
                    "no surface was found in the box of --box; check that it is in the scene's own units, where sos \
                     doctor SCENE --html shows cameras and points, or make it larger"
                        .to_owned(),
                )
            }),
            Self::Click(click) => {
                self.clicked_point(data, depths)?
                    .and_then(|point| parts.at(point))
                    .ok_or_else(|| {
                        PrepareError::Scene(format!(
                            "--click {}: nothing that stands out from the ground was found at \
                             ({}, {}); click on the middle of the object, or give a mask",
                            click.view, click.x, click.y
                        ))
                    })
            }
            Self::Masks(masks) => spread_masks(masks, data, depths, solid).ok_or_else(|| {
                PrepareError::Scene(
                    "where the few masks are white, nothing was found in the region around it; mask more photos, or \
                     give the region with --masks none and --box"
                        .to_owned(),
                )
            }),
        }
    }

    /// The place that is clicked on, in the normalised frame, where its view shows one.
    pub(super) fn clicked_point(
        &self,
        data: &Prepared,
        depths: &[DepthPicture],
    ) -> Result<Option<Vec3>, PrepareError> {
        let clicked = self.clicked(&data.views)?;
        Ok(clicked.and_then(|(view, pixel)| surface_at(data, depths, view, pixel)))
    }

    /// The pixel that is clicked on, with the number of its view.
    pub(super) fn clicked(
        &self,
        views: &[TrainView],
    ) -> Result<Option<(usize, Vec2)>, PrepareError> {
        match self {
            Self::Click(click) => {
                let pixel = Vec2::new(click.x as f32, click.y as f32);
                Ok(Some((click.find(views)?, pixel)))
            }
            _ => Ok(None),
        }
    }

    /// For the note on the choice.
    pub(super) fn reason(&self) -> &'static str {
        match self {
            Self::Nothing => "no masks: what stands in the middle of the cameras' view is",
            Self::Click(_) => "no masks: what stands at the click is",
            Self::Box(_) => "no masks: what stands in the box is",
            Self::Masks(_) => {
                "few masks: what they show, and what hangs together with it in its colours, is"
            }
        }
    }
}

/// The point that a pixel shows, in the normalised frame.
fn surface_at(data: &Prepared, depths: &[DepthPicture], view: usize, pixel: Vec2) -> Option<Vec3> {
    let photo = &data.views[view];
    let ray = photo.ray(&photo.world_from_camera(&data.frame), pixel)?;
    let distance = depths[view].at(pixel);
    distance.is_finite().then(|| ray.at(distance))
}

/// Centre and radius of a mask's white, in pixels.
fn centroid(mask: &Mask) -> Option<(DVec2, f64)> {
    let (mut sum, mut area) = (DVec2::ZERO, 0.0);
    for (x, y) in mask.pixels() {
        sum += DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        area += 1.0;
    }
    (area > 0.0).then(|| (sum / area, (area / std::f64::consts::PI).sqrt()))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn clicks_and_boxes_are_read() {
        let click: Click = "a/b:c.jpg:12.5, 7".parse().unwrap();
        assert_eq!(
            (click.view.as_str(), click.x, click.y),
            ("a/b:c.jpg", 12.5, 7.0)
        );
        for wrong in ["", "a", "a:1", "a:1,x", ":1,2", "a:inf,2"] {
            assert!(wrong.parse::<Click>().is_err(), "{wrong}");
        }
        let given: WorldBox = "-1,0,2.5, 1,2,3".parse().unwrap();
        assert_eq!((given.low, given.high), ([-1.0, 0.0, 2.5], [1.0, 2.0, 3.0]));
        for wrong in ["1,2,3", "1,0,0,0,1,1", "a,b,c,d,e,f", "0,0,0,1,1,nan"] {
            assert!(wrong.parse::<WorldBox>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_stands_beside_a_flat_box_is_not_in_it() {
        let hint = Hint::Box("2,3,4,3,4,8".parse().unwrap());
        let frame = hint.region(&[], &[]).unwrap();
        assert_eq!(
            (frame.centre, frame.half_side),
            (DVec3::new(2.5, 3.5, 6.0), 2.0)
        );
        let n = 8;
        let mut solid = vec![-1.0; n * n * n];
        hint.clip(&mut solid, n, &frame);
        for (cell, distance) in solid.iter().enumerate() {
            let at = frame.world_from_normalised(ProbabilityMap::centre(n, cell));
            let within = (at.x - 2.5).abs() < 1.0 && (at.y - 3.5).abs() < 1.0;
            assert_eq!(*distance < 0.0, within, "{at}");
        }
        let before = solid.clone();
        Hint::Nothing.clip(&mut solid, n, &frame);
        assert_eq!(solid, before);
    }

    #[test]
    fn a_view_is_found_by_any_name_that_no_other_has() {
        let names = [
            "left/001.jpg",
            "right/001.jpg",
            "right/IMG.0012.jpg",
            "IMG.jpg",
        ];
        let found = |given| view_called(given, &names).ok();
        assert_eq!(found("right/001.jpg"), Some(1));
        assert_eq!(found("right/001"), Some(1));
        assert_eq!(found("IMG.0012.jpg"), Some(2));
        assert_eq!(found("IMG.0012"), Some(2));
        assert_eq!(found("IMG.png"), Some(3));
        assert_eq!(found("002.jpg"), None);
        for both in ["001.jpg", "001", "001.png"] {
            let error = view_called(both, &names)
                .expect_err("two have it")
                .to_string();
            assert!(error.contains("left/001.jpg and right/001.jpg"), "{error}");
        }
    }
}
