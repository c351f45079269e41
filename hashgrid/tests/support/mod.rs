//! Inputs shared by the tests.
#![allow(dead_code, unreachable_pub)]

use hashgrid::{GridConfig, GridLayout, Hash, Interpolation};

/// A seeded generator.
pub struct Random(pub u64);

impl Random {
    /// Uniform in `[0, 1)`.
    pub fn unit(&mut self) -> f32 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1_u64 << 24) as f32
    }

    /// `count` values, uniform in `[-1, 1)`.
    pub fn signed(&mut self, count: usize) -> Vec<f32> {
        (0..count).map(|_| 2.0 * self.unit() - 1.0).collect()
    }

    /// `count` values, uniform in `[0, 1)`.
    pub fn units(&mut self, count: usize) -> Vec<f32> {
        (0..count).map(|_| self.unit()).collect()
    }
}

/// Six levels from 4 to 61 cells, three of them dense and three hashed.
pub fn small(interpolation: Interpolation) -> GridConfig {
    let config = GridConfig {
        levels: 6,
        base_resolution: 4,
        finest_resolution: 61,
        log2_table_size: 12,
        interpolation,
        ..Default::default()
    };
    let hashed: Vec<bool> = GridLayout::new(&config)
        .levels
        .iter()
        .map(|l| l.hash.is_some())
        .collect();
    assert_eq!(hashed, [false, false, false, true, true, true]);
    config
}

/// [`small`] in both ways to blend, each with both hashes.
pub fn smalls() -> [GridConfig; 4] {
    use Interpolation::{Linear, Smoothstep};
    [
        (Linear, Hash::Nodes),
        (Linear, Hash::Blocks),
        (Smoothstep, Hash::Nodes),
        (Smoothstep, Hash::Blocks),
    ]
    .map(|(interpolation, hash)| GridConfig {
        hash,
        ..small(interpolation)
    })
}

/// The greatest difference, as a part of `tolerance · (1 + |expected|)`; NaN counts as infinite.
pub fn worst(found: &[f32], expected: &[f32], tolerance: f32) -> f32 {
    assert_eq!(found.len(), expected.len());
    found
        .iter()
        .zip(expected)
        .map(|(f, e)| {
            let part = (f - e).abs() / (tolerance * (1.0 + e.abs()));
            if part.is_nan() { f32::INFINITY } else { part }
        })
        .fold(0.0, f32::max)
}
