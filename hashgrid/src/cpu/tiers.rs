//! Test: the kernels' bits do not depend on the vector instructions that they are compiled for.

use pulp::{Arch, Scalar, WithSimd};

use super::scatter::{Scatter, Slopes};
use super::tile::EncodeTile;
use crate::config::{GridConfig, Interpolation};
use crate::hash::Hash;
use crate::layout::GridLayout;

/// Values in `[-0.25, 1.25)` that look random.
fn noise(count: usize, seed: u32) -> Vec<f32> {
    let mut state = seed;
    let next = || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (state >> 8) as f32 / (1 << 24) as f32 * 1.5 - 0.25
    };
    std::iter::repeat_with(next).take(count).collect()
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn the_widest_instructions_give_the_scalar_bits() {
    for (interpolation, hash) in [
        (Interpolation::Linear, Hash::Nodes),
        (Interpolation::Smoothstep, Hash::Blocks),
    ] {
        let layout = GridLayout::new(&GridConfig {
            levels: 8,
            finest_resolution: 300,
            log2_table_size: 14,
            interpolation,
            hash,
            ..Default::default()
        });
        let table = noise(2 * layout.entries(), 1);
        let [x, y, z] = [2, 3, 4].map(|seed| noise(48, seed));
        let encode = |scalar: bool| {
            let mut values = vec![0.0; 16 * 48];
            let mut jacobian = vec![0.0; 48 * 48];
            let op = EncodeTile {
                layout: &layout,
                active: 8,
                table: &table,
                position: [&x, &y, &z],
                values: &mut values,
                jacobian: Some(&mut jacobian),
            };
            if scalar {
                op.with_simd(Scalar::new())
            } else {
                Arch::new().dispatch(op)
            }
            (bits(&values), bits(&jacobian))
        };
        assert_eq!(encode(true), encode(false));

        let rows: Vec<Vec<f32>> = (5..13).map(|seed| noise(48, seed)).collect();
        for slopes in [
            Slopes::None,
            Slopes::Product {
                scale: [&rows[2], &rows[3]],
                normal: [&rows[4], &rows[5], &rows[6]],
            },
            Slopes::Full([
                [&rows[2], &rows[3], &rows[4]],
                [&rows[5], &rows[6], &rows[7]],
            ]),
        ] {
            for level in &layout.levels {
                let scatter = |scalar: bool| {
                    let mut grad = vec![0.0; 2 * level.entries];
                    let op = Scatter {
                        level,
                        smooth: interpolation == Interpolation::Smoothstep,
                        position: [&x, &y, &z],
                        d_value: [&rows[0], &rows[1]],
                        slopes,
                        prefetch_offset: 0,
                        grad: &mut grad,
                        touched: None,
                    };
                    if scalar {
                        op.with_simd(Scalar::new())
                    } else {
                        Arch::new().dispatch(op)
                    }
                    bits(&grad)
                };
                assert_eq!(scatter(true), scatter(false));
            }
        }
    }
}
