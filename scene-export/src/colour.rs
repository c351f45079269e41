//! sRGB (IEC 61966-2-1) and linear light.

/// Linear light of each sRGB byte.
pub(crate) fn linear_table() -> [f32; 256] {
    std::array::from_fn(|byte| linear(byte as f64 / 255.0) as f32)
}

fn linear(srgb: f64) -> f64 {
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
        let table = linear_table();
        assert_eq!((table[0], table[255]), (0.0, 1.0));
        assert!((table[128] - 0.215_860_5).abs() < 1e-6);
        assert!((table[10] - 10.0 / 255.0 / 12.92).abs() < 1e-9);
        assert!(table.windows(2).all(|pair| pair[0] < pair[1]));
    }
}
