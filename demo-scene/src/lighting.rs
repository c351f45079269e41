//! Light: one large window, the room's diffuse light with occlusion by what is near, a highlight.
//!
//! Every quantity is computed twice, with and without the target as an occluder, so that one pass
//! renders the photo, the plate that keeps the target's shadow and the plate without it.

use glam::{DVec2, DVec3};

use crate::paint::Material;
use crate::stage::{Hit, Stage, TARGET};

/// Centre of the window, stage frame.
const WINDOW: DVec3 = DVec3::new(-1.25, 1.05, 1.55);
/// Tangent of the window's angular radius seen from the table: the width of penumbrae.
const WINDOW_SPREAD: f64 = 0.17;
const WINDOW_LIGHT: DVec3 = DVec3::new(2.85, 2.66, 2.36);
const CEILING_LIGHT: DVec3 = DVec3::new(0.42, 0.44, 0.49);
const FLOOR_LIGHT: DVec3 = DVec3::new(0.22, 0.16, 0.115);
/// A lamp somewhere behind: fills the side that faces away from the window.
const FILL: DVec3 = DVec3::new(0.25, 0.18, 0.11);
const FILL_FROM: DVec3 = DVec3::new(0.70, -0.55, 0.46);

/// How far nearby things take away room light.
const OCCLUSION_REACH: f64 = 0.16;

/// What reaches a point: shares in `[0, 1]` of window and room light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reach {
    window: f64,
    room: f64,
}

/// [`Reach`] with the target in place and without it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Visibility {
    pub(crate) with_target: Reach,
    pub(crate) without_target: Reach,
}

/// Shadow and occlusion at a hit.
pub(crate) fn visibility(stage: &Stage, hit: &Hit) -> Visibility {
    let from = hit.point + hit.normal * 6e-4;
    let to_window = WINDOW - from;
    let distance = to_window.length();
    let along = to_window / distance;
    let facing = hit.normal.dot(along) > -0.05;
    let (mut shadow, mut target_shadow) = (1.0, 1.0);
    const TAPS: [f64; 5] = [0.004, 0.013, 0.032, 0.070, OCCLUSION_REACH];
    let (mut gap, mut gap_without) = (TAPS, TAPS);
    for (index, prop) in stage.props.iter().enumerate() {
        let to_prop = prop.centre - from;
        let own = hit.prop == Some(index);
        if facing {
            let middle = to_prop.dot(along);
            let aside = (to_prop.length_squared() - middle * middle).max(0.0).sqrt();
            if middle > -prop.radius && aside < prop.radius + WINDOW_SPREAD * (middle + prop.radius)
            {
                let start = (middle - 1.0 * prop.radius - 0.02).max(0.004);
                let end = (middle + prop.radius + 0.02).min(distance);
                let light = if own {
                    // A thing shades itself with its walls, which count as thick.
                    penumbra(|t| thick(prop.sdf(from + along * t)), start, end)
                } else {
                    penumbra(|t| prop.filled_sdf(from + along * t), start, end)
                };
                if index == TARGET {
                    target_shadow *= light;
                } else {
                    shadow *= light;
                }
            }
        }
        if to_prop.length() < prop.radius + 2.0 * OCCLUSION_REACH {
            for (k, tap) in TAPS.iter().enumerate() {
                let p = from + hit.normal * *tap;
                // The bounding sphere rules most things out.
                if (prop.centre - p).length() - prop.radius < gap[k].min(*tap) || own {
                    let d = prop.sdf(p);
                    gap[k] = gap[k].min(d);
                    if index != TARGET {
                        gap_without[k] = gap_without[k].min(d);
                    }
                }
            }
        }
    }
    let open = |gap: &[f64; 5]| {
        let mut occluded = 0.0;
        for (k, (tap, weight)) in TAPS.iter().zip([0.16, 0.20, 0.24, 0.22, 0.18]).enumerate() {
            occluded += weight * (1.0 - gap[k] / tap).clamp(0.0, 1.0);
        }
        (1.0 - 1.15 * occluded).max(0.08)
    };
    Visibility {
        with_target: Reach {
            window: shadow * target_shadow,
            room: open(&gap),
        },
        without_target: Reach {
            window: shadow,
            room: open(&gap_without),
        },
    }
}

/// Deepens a thin wall to ten times its thickness.
fn thick(h: f64) -> f64 {
    if h < 0.0 { 10.0 * h } else { h }
}

/// Share of a round light seen past a solid: the closest approach of the ray relative to the cone
/// towards the light (after Aaltonen and Quilez), which may also be negative, so that half the
/// light is left exactly at the geometric shadow edge.
fn penumbra(sdf: impl Fn(f64) -> f64, start: f64, end: f64) -> f64 {
    let (mut t, mut least) = (start, 1.0_f64);
    for _ in 0..36 {
        let h = sdf(t);
        least = least.min(h / (WINDOW_SPREAD * t));
        if least <= -1.0 {
            return 0.0;
        }
        t += h.abs().clamp(0.004 + 0.012 * t, 0.25);
        if t > end {
            break;
        }
    }
    let s = least.max(-1.0);
    0.25 * (1.0 + s) * (1.0 + s) * (2.0 - s)
}

/// Linear radiance towards `-along`.
pub(crate) fn radiance(hit: &Hit, material: &Material, along: DVec3, reach: &Reach) -> DVec3 {
    let n = hit.normal;
    let to_window = WINDOW - hit.point;
    let distance = to_window.length();
    let l = to_window / distance;
    // Wrapped a little, as a light of this size does.
    let lambert = ((n.dot(l) + 0.08) / 1.08).max(0.0);
    // Equal on the table, weaker far from the window, bounded near it.
    let strength = (5.2 / (distance * distance + 0.6)).min(1.5);
    let up = 0.5 + 0.5 * n.z;
    let ambient =
        FLOOR_LIGHT + (CEILING_LIGHT - FLOOR_LIGHT) * up + FILL * (0.5 + 0.5 * n.dot(FILL_FROM));
    let diffuse = WINDOW_LIGHT * (lambert * strength * reach.window) + ambient * reach.room;
    let half = (l - along).normalize_or(n);
    let mut lobe = n.dot(half).max(0.0);
    for _ in 0..material.sharpness {
        lobe *= lobe;
    }
    let grazing = 1.0 - n.dot(-along).clamp(0.0, 1.0);
    let fresnel = 0.3 + 0.7 * grazing * grazing * grazing;
    let sheen = material.gloss * fresnel;
    let highlight = WINDOW_LIGHT * (sheen * 2.0 * lobe * strength * reach.window)
        + CEILING_LIGHT * (0.35 * sheen * reach.room * (0.3 + 0.7 * up));
    material.albedo * diffuse + highlight
}

/// Lens falloff towards the corners: `offset` is measured from the image centre in half diagonals.
pub(crate) fn vignette(offset: DVec2) -> f64 {
    1.0 - 0.07 * offset.length_squared()
}
