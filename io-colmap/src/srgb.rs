//! sRGB (IEC 61966-2-1) and linear light, both from 0 to 1.

/// sRGB of linear light; black for what is no number, as a renderer leaves here and there.
#[must_use]
pub fn srgb_from_linear(light: f32) -> f32 {
    let light = if light.is_nan() {
        0.0
    } else {
        light.clamp(0.0, 1.0)
    };
    if light <= 0.003_130_8 {
        12.92 * light
    } else {
        1.055 * light.powf(1.0 / 2.4) - 0.055
    }
}

/// Linear light of an sRGB byte.
#[must_use]
pub fn linear_from_srgb(byte: u8) -> f64 {
    let srgb = f64::from(byte) / 255.0;
    if srgb <= 0.040_45 {
        srgb / 12.92
    } else {
        ((srgb + 0.055) / 1.055).powf(2.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_is_the_standards() {
        assert_eq!((linear_from_srgb(0), linear_from_srgb(255)), (0.0, 1.0));
        assert!((linear_from_srgb(128) - 0.215_860_5).abs() < 1e-6);
        assert!((linear_from_srgb(10) - 10.0 / 255.0 / 12.92).abs() < 1e-12);
    }

    #[test]
    fn both_ways_lead_back() {
        for byte in 0..=255 {
            let back = 255.0 * srgb_from_linear(linear_from_srgb(byte) as f32);
            assert!((back - f32::from(byte)).abs() < 1e-3, "{byte}: {back}");
        }
        assert_eq!(srgb_from_linear(f32::NAN), 0.0);
        // As near as single precision comes.
        assert!((srgb_from_linear(7.0) - 1.0).abs() < 1e-6);
    }
}
