//! All pictures of one view, at the photo's own size.

use glam::{Vec2, Vec3};
use neus_render::rays::Ray;
use rayon::prelude::*;

use super::edge_width::EdgeWidth;
use super::fill::fill;
use super::photo_outline::follow_photo;
use super::rays::{FrozenScene, RenderedRay};
use super::survey::Survey;
use crate::cells::grown;
use crate::export::ViewRender;
use crate::prepare::{Prepared, outline};
use crate::snap;
use crate::squares::Squares;

/// Mattes that differ by more than this from a neighbour's make an edge.
const EDGE: f32 = 0.05;
/// Mattes below this, a quarter of an 8 bit step, have no colour worth computing.
const LEAST_ALPHA: f32 = 1e-3;
/// Opacities of the object below this say little about its colour.
const LEAST_OPACITY: f32 = 0.02;
/// How far away its colour is looked for then, in [`Squares`].
const COLOUR_REACH: u32 = 4;
/// How far around the object the plate is taken from BaCo instead of the photo, in [`Squares`].
const PLATE_REACH: i32 = 3;
/// Views that must have seen what the object hides for plates to show it as it was learnt: fewer may all be wrong.
const LEAST_SEEN: u8 = 3;
/// Pixels of which one task asks all views.
const PIXELS_PER_TASK: usize = 1024;

/// In the list of pixels' rays, a pixel without one.
const NO_RAY: u32 = u32::MAX;

/// The matte of view `index`, edges supersampled and where the photo has them: `width * height` values in 0..1, rows from
/// the top.
#[must_use]
pub fn render_matte(scene: &FrozenScene, data: &Prepared, index: usize) -> Vec<f32> {
    let view = &data.views[index];
    let (width, height) = (view.width(), view.height());
    let world_from_camera = view.world_from_camera(&data.frame);
    let ray_at = |pixel: Vec2| view.ray(&world_from_camera, pixel);
    // Only where the object can be: elsewhere its matte is zero.
    let candidates = outline::candidates(view, &data.frame, &scene.map, &scene.config.prepare);
    let (mut at, mut rays) = (Vec::new(), Vec::new());
    for i in candidates.iter() {
        if let Some(ray) = ray_at(centre(i, width)) {
            at.push(i);
            rays.push(ray);
        }
    }
    let mut alpha = vec![0.0f32; (width * height) as usize];
    for (&i, matte) in at.iter().zip(scene.mattes(&rays)) {
        alpha[i as usize] = matte;
    }
    // Before, for what is thinner than a pixel; afterwards, for what was too soft to differ from its neighbours.
    let mut edge = edge_pixels(&alpha, &at, width, height);
    let edge_width = EdgeWidth::new(scene, view.pixel_at_object(&data.frame) as f32);
    for &i in &at {
        alpha[i as usize] = edge_width.of(alpha[i as usize]);
    }
    edge.extend(edge_pixels(&alpha, &at, width, height));
    edge.sort_unstable();
    edge.dedup();
    supersample(scene, &ray_at, &edge, width, edge_width, &mut alpha);
    if scene.config.export.follow_photos {
        follow_photo(view, &mut alpha);
    }
    alpha
}

/// Renders view `index`.
#[must_use]
pub fn render_view(
    scene: &FrozenScene,
    data: &Prepared,
    survey: &Survey,
    index: usize,
) -> ViewRender {
    let view = &data.views[index];
    let (width, height) = (view.width(), view.height());
    let pixels = (width * height) as usize;
    let world_from_camera = view.world_from_camera(&data.frame);
    let alpha = render_matte(scene, data, index);

    // Colours only where something of the object is, and close by for the plate's seam; and where
    // plates do without what the photo shows.
    let ignored = |i: u32| view.ignores(i % width, i / width);
    let visible: Vec<bool> = (0..width * height)
        .map(|i| alpha[i as usize] > LEAST_ALPHA || ignored(i))
        .collect();
    let squares = Squares::new(width, height, snap::LONGEST);
    // Up to one square more on either side, of those that a pixel lies between.
    let margin = PLATE_REACH as u32 * squares.side + 2 * (squares.side - 1);
    let wanted = grown(&visible, width as usize, margin as usize);
    let (mut hits, mut rays) = (vec![NO_RAY; pixels], Vec::new());
    for i in (0..width * height).filter(|&i| wanted[i as usize]) {
        if let Some(ray) = view.ray(&world_from_camera, centre(i, width)) {
            hits[i as usize] = rays.len() as u32;
            rays.push(ray);
        }
    }
    let rendered = scene.render(&rays);

    let reach = reach_of(&alpha, &squares);
    let mut out = ViewRender {
        name: view.name.clone(),
        width,
        height,
        foreground: vec![[0.0; 3]; pixels],
        background: vec![[0.0; 3]; pixels],
        seen: vec![0; pixels],
        normal: vec![[0.0; 3]; pixels],
        depth: vec![0.0; pixels],
        alpha,
    };
    let normals = object_normals(scene, &rays, &rendered);
    // The object's own colour, which is known where the surface is; its outline may be the photo's.
    let object_colour = |i: usize| -> Option<Vec3> {
        let hit = rendered.get(hits[i] as usize)?;
        (hit.object_opacity >= LEAST_OPACITY).then_some(hit.object)
    };
    // Of a plate's own pixels, which each view is asked about: nearly all of the time that is not spent on rays.
    let plate_share = |i: usize| if ignored(i as u32) { 1.0 } else { reach[i] };
    let all = data.views.len().min(255) as u8;
    out.seen
        .par_iter_mut()
        .with_min_len(PIXELS_PER_TASK)
        .enumerate()
        .for_each(|(i, seen)| {
            let ray = hits[i] as usize;
            *seen = match rendered.get(ray) {
                Some(hit) if plate_share(i) > 0.0 => {
                    survey.seen(data, &rays[ray], hit.background_distance, hit.background)
                }
                _ => all,
            };
        });
    // What stands behind the object, before the photo's share along the seam is mixed in.
    let mut behind = vec![[0.0; 3]; pixels];
    for i in 0..pixels {
        let photo = photo_colour(view.photo.as_raw(), i);
        let k = hits[i] as usize;
        if hits[i] == NO_RAY {
            out.foreground[i] = photo.to_array();
            behind[i] = photo.to_array();
            continue;
        }
        let hit = &rendered[k];
        behind[i] = if plate_share(i) > 0.0 {
            hit.background.to_array()
        } else {
            photo.to_array()
        };
        let own = object_colour(i)
            .or_else(|| {
                mean_around(
                    &object_colour,
                    i,
                    (width, height),
                    COLOUR_REACH * squares.side,
                )
            })
            .unwrap_or(photo);
        let own = if ignored(i as u32) {
            // The photo shows what is not to be learned from.
            own
        } else {
            decontaminated(photo, own, hit.background, out.alpha[i])
        };
        out.foreground[i] = own.to_array();
        if hit.object_distance > 0.0 && out.alpha[i] > 0.05 {
            out.normal[i] = normals[k].to_array();
            let point = data
                .frame
                .world_from_normalised(rays[k].at(hit.object_distance));
            out.depth[i] = view.camera_from_world.transform_point(point).z as f32;
        }
    }
    if scene.config.export.fill_unseen {
        fill(&mut behind, |i| out.seen[i] >= LEAST_SEEN, width as usize);
    }
    for (i, (plate, behind)) in out.background.iter_mut().zip(behind).enumerate() {
        let photo = photo_colour(view.photo.as_raw(), i);
        *plate = photo.lerp(behind.into(), plate_share(i)).to_array();
    }
    out
}

/// The middle of pixel number `i`.
fn centre(i: u32, width: u32) -> Vec2 {
    Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5)
}

fn photo_colour(raw: &[u8], i: usize) -> Vec3 {
    let c = &raw[3 * i..3 * i + 3];
    Vec3::new(f32::from(c[0]), f32::from(c[1]), f32::from(c[2])) / 255.0
}

/// The mean of colours that are known within `reach` pixels of pixel `i`, nearer ones counting more; `None` where there are
/// none.
fn mean_around(
    colour: &dyn Fn(usize) -> Option<Vec3>,
    i: usize,
    (width, height): (u32, u32),
    reach: u32,
) -> Option<Vec3> {
    let (x, y) = (i as u32 % width, i as u32 / width);
    let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
    for v in y.saturating_sub(reach)..=(y + reach).min(height - 1) {
        for u in x.saturating_sub(reach)..=(x + reach).min(width - 1) {
            if let Some(colour) = colour((v * width + u) as usize) {
                let weight = 1.0 / (u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2)).max(1) as f32;
                sum += weight * colour;
                weights += weight;
            }
        }
    }
    (weights > 0.0).then(|| sum / weights)
}

/// The object's own colour behind a soft edge: `F = (C - (1 - a) B) / a`, where that is determined.
///
/// With little alpha the division only amplifies noise, and the `own` colour, as rendered, takes over.
fn decontaminated(photo: Vec3, own: Vec3, background: Vec3, alpha: f32) -> Vec3 {
    if alpha >= 0.995 {
        return photo;
    }
    if alpha < LEAST_ALPHA {
        return own;
    }
    let solved = ((photo - (1.0 - alpha) * background) / alpha).clamp(Vec3::ZERO, Vec3::ONE);
    own.lerp(solved, ((alpha - 0.3) / 0.6).clamp(0.0, 1.0))
}

/// Unit normals of the object where rays meet it.
fn object_normals(scene: &FrozenScene, rays: &[Ray], rendered: &[RenderedRay]) -> Vec<Vec3> {
    let points: Vec<f32> = rays
        .iter()
        .zip(rendered)
        .flat_map(|(ray, hit)| ray.at(hit.object_distance).to_array())
        .collect();
    let gradients = scene.object_field().gradients_of(points);
    gradients
        .into_iter()
        .map(|gradient| gradient.normalize_or_zero())
        .collect()
}

/// Which of the pixels `at` have a neighbour with another matte.
fn edge_pixels(alpha: &[f32], at: &[u32], width: u32, height: u32) -> Vec<u32> {
    let (w, h) = (width as i32, height as i32);
    let differs = |&i: &u32| {
        let (x, y) = ((i % width) as i32, (i / width) as i32);
        let own = alpha[i as usize];
        [(-1, 0), (1, 0), (0, -1), (0, 1)].iter().any(|(dx, dy)| {
            let (x, y) = (x + dx, y + dy);
            let inside = x >= 0 && y >= 0 && x < w && y < h;
            inside && (alpha[(y * w + x) as usize] - own).abs() > EDGE
        })
    };
    at.iter().copied().filter(differs).collect()
}

/// Replaces the matte of `edge` pixels by the mean over rays spread over the pixel.
fn supersample(
    scene: &FrozenScene,
    ray_at: &dyn Fn(Vec2) -> Option<Ray>,
    edge: &[u32],
    width: u32,
    edge_width: EdgeWidth,
    alpha: &mut [f32],
) {
    let count = scene.config.export.edge_rays;
    if count <= 1 {
        return;
    }
    let (mut rays, mut owner) = (Vec::new(), Vec::new());
    for &i in edge {
        let corner = Vec2::new((i % width) as f32, (i / width) as f32);
        for k in 0..count {
            // Evenly spread over the pixel: the additive recurrence of the plastic number.
            let offset = Vec2::new(
                (0.5 + 0.754_877_7 * k as f32).fract(),
                (0.5 + 0.569_840_3 * k as f32).fract(),
            );
            if let Some(ray) = ray_at(corner + offset) {
                rays.push(ray);
                owner.push(i as usize);
            }
        }
    }
    let mut sums = vec![(0.0f32, 0u32); alpha.len()];
    for (&i, matte) in owner.iter().zip(scene.mattes(&rays)) {
        sums[i].0 += edge_width.of(matte);
        sums[i].1 += 1;
    }
    for (alpha, (sum, count)) in alpha.iter_mut().zip(sums) {
        if count > 0 {
            *alpha = sum / count as f32;
        }
    }
}

/// How much of the plate comes from BaCo, for each pixel: 1 on the object and a square around, fading out beyond.
fn reach_of(alpha: &[f32], squares: &Squares) -> Vec<f32> {
    let (w, h) = (squares.columns as i32, squares.rows as i32);
    let alphas = squares.largest(alpha);
    let mut reach = vec![0.0f32; alphas.len()];
    for y in 0..h {
        for x in 0..w {
            let a = alphas[(y * w + x) as usize];
            if a <= 0.02 {
                continue;
            }
            for dy in -PLATE_REACH..=PLATE_REACH {
                for dx in -PLATE_REACH..=PLATE_REACH {
                    let (x, y) = (x + dx, y + dy);
                    if x < 0 || y < 0 || x >= w || y >= h {
                        continue;
                    }
                    let distance = ((dx * dx + dy * dy) as f32).sqrt();
                    let share =
                        (1.0 - (distance - 1.5) / (PLATE_REACH as f32 - 1.0)).clamp(0.0, 1.0);
                    let value = share * (a / 0.1).min(1.0);
                    let slot = &mut reach[(y * w + x) as usize];
                    *slot = slot.max(value);
                }
            }
        }
    }
    squares.spread(&reach)
}
