//! Surface colours: linear RGB reflectance plus gloss, and the brushes materials are mixed with.

use glam::DVec3;

use crate::noise::{fbm3, smoothstep};

/// What light does at a surface point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Material {
    /// Linear RGB reflectance.
    pub(crate) albedo: DVec3,
    /// Strength of the highlight, 0 (chalk) to about 0.5 (glaze).
    pub(crate) gloss: f64,
    /// The highlight's exponent is two to this power.
    pub(crate) sharpness: u32,
}

impl Material {
    /// A dull surface.
    pub(crate) fn matt(albedo: DVec3) -> Self {
        Self {
            albedo,
            gloss: 0.04,
            sharpness: 3,
        }
    }

    /// A shiny one.
    pub(crate) fn glossy(albedo: DVec3, gloss: f64) -> Self {
        Self {
            albedo,
            gloss,
            sharpness: 6,
        }
    }
}

/// Linear colour of the sRGB triple `0xRRGGBB`.
pub(crate) fn rgb(hex: u32) -> DVec3 {
    let channel = |shift: u32| {
        let c = f64::from((hex >> shift) & 0xff) / 255.0;
        // Cubic fit of the sRGB curve: plain arithmetic, the same on every platform.
        c * (c * (c * 0.305_306_011 + 0.682_171_111) + 0.012_522_878)
    };
    DVec3::new(channel(16), channel(8), channel(0))
}

/// `a` where `t` is 0, `b` where it is 1.
pub(crate) fn mix(a: DVec3, b: DVec3, t: f64) -> DVec3 {
    a + (b - a) * t
}

/// Multiplies a colour by mottling with features of about `size` metres.
pub(crate) fn mottle(colour: DVec3, p: DVec3, size: f64, strength: f64, seed: u32) -> DVec3 {
    colour * (1.0 + strength * fbm3(p / size, 3, seed))
}

/// Soft indicator of `d < 0` for a pattern distance `d` in metres, about a millimetre wide.
pub(crate) fn ink(d: f64) -> f64 {
    smoothstep(0.0006, -0.0006, d)
}
