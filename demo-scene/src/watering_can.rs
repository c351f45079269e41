//! The target: a small enamelled watering can.
//!
//! Its own frame stands on the table at the origin, z up, spout towards +x; metres. The can has a
//! hollow body, two handles one can reach through, a thin brace that closes a third opening, and
//! a thin spout: the things a coarse segmentation gets wrong.

use glam::{DVec2, DVec3};

use crate::noise::{fbm3, hash3, smoothstep, speckle3, unit};
use crate::paint::{Material, ink, mix, mottle, rgb};
use crate::primitives::{arc, capsule, frustum, nearest, ring, smooth_max, smooth_min};

/// Half extents and centre of a box around the can, in its own frame.
pub(crate) const HALF: DVec3 = DVec3::new(0.178, 0.086, 0.112);
pub(crate) const CENTRE: DVec3 = DVec3::new(0.042, 0.0, 0.107);

const SPOUT: [(DVec3, f64); 4] = [
    (DVec3::new(0.055, 0.0, 0.036), 0.0175),
    (DVec3::new(0.112, 0.0, 0.076), 0.0125),
    (DVec3::new(0.160, 0.0, 0.160), 0.0090),
    (DVec3::new(0.176, 0.0, 0.182), 0.0085),
];
/// Direction of the sprinkler rose: the spout's last stretch.
const ROSE_AXIS: DVec3 = DVec3::new(0.6, 0.0, 0.8);
const BODY_HEIGHT: f64 = 0.150;

/// Distances to the differently painted parts.
struct Parts {
    shell: f64,
    inside: f64,
    spout: f64,
    rose: f64,
    brace: f64,
    back_handle: f64,
    top_handle: f64,
    rim: f64,
    lid: f64,
}

impl Parts {
    fn at(p: DVec3) -> Self {
        let q = DVec2::new(p.truncate().length(), p.z);
        let middle = DVec2::new(0.0, 0.5 * BODY_HEIGHT);
        let shell = frustum(q - middle, 0.5 * BODY_HEIGHT - 0.005, 0.073, 0.0555) - 0.005;
        let inside = frustum(q - DVec2::new(0.0, 0.085), 0.075, 0.0685, 0.0505);
        let [a, b, c, d] = SPOUT;
        let spout = smooth_min(
            smooth_min(
                capsule(p, a.0, b.0, a.1, b.1),
                capsule(p, b.0, c.0, b.1, c.1),
                0.008,
            ),
            capsule(p, c.0, d.0, c.1, d.1),
            0.004,
        );
        let from_tip = p - d.0;
        let along = from_tip.dot(ROSE_AXIS);
        let across = (from_tip - ROSE_AXIS * along).length();
        let rose = frustum(DVec2::new(across, along - 0.010), 0.011, 0.0085, 0.0235) - 0.0015;
        let brace = capsule(
            p,
            DVec3::new(0.056, 0.0, 0.128),
            DVec3::new(0.148, 0.0, 0.139),
            0.0036,
            0.0036,
        );
        // The handles stand in the xz plane.
        let from_back = p - DVec3::new(-0.068, 0.0, 0.085);
        let back_handle = arc(
            DVec3::new(from_back.z, -from_back.x, p.y),
            DVec2::new(0.9659, -0.2588),
            0.051,
            0.0075,
        );
        let top_handle = arc(
            DVec3::new(p.x, p.z - BODY_HEIGHT + 0.002, p.y),
            DVec2::new(1.0, 0.0),
            0.055,
            0.0058,
        );
        let rim = ring(q - DVec2::new(0.0, BODY_HEIGHT), 0.0575, 0.0048);
        let lid = ((p.z - BODY_HEIGHT + 0.003).abs() - 0.003)
            .max(q.x - 0.056)
            .max(0.006 - p.x);
        Self {
            shell,
            inside,
            spout,
            rose,
            brace,
            back_handle,
            top_handle,
            rim,
            lid,
        }
    }

    fn union(&self) -> f64 {
        let solid = smooth_min(self.shell, self.spout, 0.012);
        let solid = smooth_min(solid, self.back_handle, 0.008);
        let solid = smooth_min(solid, self.brace, 0.004);
        let hollow = smooth_max(solid, -self.inside, 0.003);
        let tip = smooth_min(hollow, self.rose, 0.004);
        let brim = smooth_min(smooth_min(tip, self.rim, 0.004), self.lid, 0.002);
        smooth_min(brim, self.top_handle, 0.006)
    }
}

/// Signed distance (a lower bound with slope at most one) in the can's own frame.
pub(crate) fn sdf(p: DVec3) -> f64 {
    Parts::at(p).union()
}

/// The can as if it were solid: what shadows of other things are computed with, since the
/// penumbra rule needs the depth of a solid, not the thickness of a wall.
pub(crate) fn filled_sdf(p: DVec3) -> f64 {
    let parts = Parts::at(p);
    let solid = smooth_min(
        smooth_min(parts.shell, parts.spout, 0.012),
        parts.back_handle,
        0.008,
    );
    solid
        .min(parts.brace)
        .min(parts.rose)
        .min(parts.rim)
        .min(parts.top_handle)
}

/// Paint at a surface point of the can's own frame.
pub(crate) fn material(p: DVec3) -> Material {
    let parts = Parts::at(p);
    let teal = glaze(p, rgb(0x1d6f78), rgb(0x0f4a58));
    let cream = glaze(p, rgb(0xe9dcc0), rgb(0xd3bd94));
    let copper = mottle(rgb(0xb8703c), p, 0.006, 0.5, 71);
    let part = nearest(&[
        parts.spout,
        parts.rose,
        parts.brace,
        parts.back_handle,
        parts.top_handle,
        parts.rim,
        parts.lid,
        parts.shell.max(-parts.inside) - 0.0005,
    ]);
    let colour = match part {
        0 => {
            // Cream rings along the spout, each with its own width.
            let s = p.x + 0.35 * p.z;
            let band = (s / 0.021).floor();
            let width = 0.0025 + 0.004 * unit(hash3(band as i32, 3, 1, 72));
            mix(teal, cream, ink((s - (band + 0.5) * 0.021).abs() - width))
        }
        1 => {
            let holes = speckle3(p / 0.0075, 0.9, 0.38, 73);
            mix(copper, rgb(0x1c120c), 0.9 * holes)
        }
        2 => copper,
        3 | 4 => rattan(p),
        5 => mix(
            cream,
            rgb(0xa8432c),
            smoothstep(-0.2, 0.5, fbm3(p / 0.009, 3, 74)),
        ),
        6 => {
            let d = (p - DVec3::new(0.028, 0.004, p.z)).length();
            mix(teal, rgb(0xe7b23b), ink((d - 0.013).abs() - 0.004))
        }
        _ if parts.inside.abs() < 0.0015 && p.z < BODY_HEIGHT - 0.002 => {
            mottle(cream, p, 0.012, 0.35, 75)
        }
        _ => painted_body(p, teal, cream),
    };
    Material::glossy(colour, if part == 3 || part == 4 { 0.08 } else { 0.32 })
}

/// Speckled ceramic glaze: cloudy between two colours, with dark and light spots.
pub(crate) fn glaze(p: DVec3, light: DVec3, dark: DVec3) -> DVec3 {
    let cloud = smoothstep(-0.45, 0.45, fbm3(p / 0.016, 4, 61));
    let base = mottle(mix(dark, light, cloud), p, 0.0035, 0.22, 62);
    let dark_spots = speckle3(p / 0.0095, 0.55, 0.30, 63).max(speckle3(p / 0.0061, 0.4, 0.32, 64));
    let light_spots = speckle3(p / 0.0125, 0.35, 0.20, 65);
    let spotted = mix(base, rgb(0x2a1d17), 0.8 * dark_spots);
    mix(spotted, rgb(0xfff6e0), 0.75 * light_spots)
}

/// Wound cane: slanted turns with fibres and a few dark ones.
pub(crate) fn rattan(p: DVec3) -> DVec3 {
    let s = (p.x * 0.9 + p.z * 1.0 + p.y * 0.4 + 0.0015 * fbm3(p / 0.008, 2, 66)) / 0.0088;
    let turn = s.floor();
    let within = s - turn;
    let tone = unit(hash3(turn as i32, 5, 2, 67));
    let colour = mix(rgb(0xa9763a), rgb(0x5a3416), tone * tone);
    let groove = smoothstep(0.0, 0.18, within) * smoothstep(1.0, 0.8, within);
    mottle(colour * (0.35 + 0.75 * groove), p, 0.003, 0.35, 68)
}

/// Teal body with a cream belt of flowers, no two alike.
fn painted_body(p: DVec3, teal: DVec3, cream: DVec3) -> DVec3 {
    const FLOWERS: i32 = 9;
    let turn = libm::atan2(p.y, p.x) / core::f64::consts::TAU;
    let wobble = 0.0016 * fbm3(p / 0.02, 2, 76);
    let z = p.z + wobble;
    let belt = (z - 0.076).abs() - 0.034;
    let mut colour = mix(teal, cream, ink(belt));
    let rust = mottle(rgb(0xb5472b), p, 0.005, 0.3, 77);
    colour = mix(
        colour,
        rust,
        ink((belt + 0.0045).abs() - 0.0014).max(ink((belt - 0.005).abs() - 0.0012)),
    );
    // Dots above and below the belt.
    let dot_turn = (turn + 0.5) * 30.0;
    let dot = DVec2::new(
        (dot_turn - dot_turn.floor() - 0.5) * 0.0145,
        (z - 0.076).abs() - 0.047,
    );
    if !hash3(dot_turn.floor() as i32, i32::from(z > 0.076), 4, 78).is_multiple_of(4) {
        colour = mix(colour, rgb(0xe9b949), ink(dot.length() - 0.0030));
    }
    // One flower per sector, its place, size and colour drawn from a hash.
    let sector = ((turn + 0.5) * f64::from(FLOWERS)).floor();
    let h = |n: i32| unit(hash3(sector as i32, n, 9, 79));
    let x = ((turn + 0.5) * f64::from(FLOWERS) - sector - 0.5) * 0.049 - 0.010 * (h(1) - 0.5);
    let y = z - 0.076 - 0.018 * (h(2) - 0.5);
    let size = 0.75 + 0.40 * h(3);
    let (tilt_c, tilt_s) = (1.0 - 0.5 * h(4) * h(4), h(4) - 0.5);
    let q = DVec2::new(tilt_c * x - tilt_s * y, tilt_s * x + tilt_c * y) / size;
    // A stem and two leaves below the blossom.
    let leaf = |c: DVec2, a: DVec2| {
        let r = q - c;
        DVec2::new(r.dot(a) * 0.45, r.dot(a.perp()) * 1.2).length() - 0.0036
    };
    let stem = (q.x + 0.15 * q.y).abs().max((q.y + 0.016).abs() - 0.014) - 0.0009;
    let green = leaf(DVec2::new(-0.008, -0.015), DVec2::new(0.8, -0.6))
        .min(leaf(DVec2::new(0.0085, -0.017), DVec2::new(0.7, 0.71)))
        .min(stem);
    colour = mix(
        colour,
        mottle(rgb(0x3f6b2c), p, 0.004, 0.4, 80),
        ink(green * size) * ink(belt + 0.006),
    );
    let petal_colour =
        [0xc8352b, 0x3a4fa0, 0xd9772a, 0x8d3a80, 0xcf9a1e][(h(5) * 5.0) as usize % 5];
    const PETALS: [DVec2; 5] = [
        DVec2::new(0.0, 1.0),
        DVec2::new(0.951, 0.309),
        DVec2::new(0.588, -0.809),
        DVec2::new(-0.588, -0.809),
        DVec2::new(-0.951, 0.309),
    ];
    let petals = PETALS
        .iter()
        .map(|at| (q - *at * 0.0075).length() - 0.0052)
        .fold(f64::MAX, f64::min);
    colour = mix(
        colour,
        mottle(rgb(petal_colour), p, 0.004, 0.35, 81),
        ink(petals * size),
    );
    mix(colour, rgb(0xf2d36a), ink((q.length() - 0.0035) * size))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::Rng;

    #[test]
    fn the_box_holds_the_can() {
        let mut rng = Rng::new(4, 4);
        for _ in 0..20_000 {
            let mut side = || rng.range(-1.0, 1.0);
            let face = DVec3::new(side(), side(), side());
            let p = CENTRE + HALF * (face / face.abs().max_element());
            assert!(sdf(p) > 0.0, "{p}");
        }
    }

    #[test]
    fn fingers_fit_through_the_handles_and_the_brace_loop() {
        for p in [
            DVec3::new(-0.09, 0.0, 0.085),
            DVec3::new(0.0, 0.0, 0.178),
            DVec3::new(0.095, 0.0, 0.105),
        ] {
            assert!(sdf(p) > 0.009, "{p} {}", sdf(p));
        }
    }
}
