//! The slice kernels against the textbook formula in f64, and at the edges of their domain.
#![allow(missing_docs, clippy::unwrap_used)]

mod support;

use hashgrid::{GridConfig, GridLayout, Hash, Interpolation, LevelLayout, cpu};
use support::{Random, small, smalls, worst};

/// Entries are of size 1; an f32 blend of eight rounds some ten times.
const VALUE: f32 = 2e-6;
/// Central differences in f64 with a step of 1e-6 are exact to about 1e-9 of a resolution; the rest
/// is f32 rounding of differences of entries, times a resolution of up to 61.
const JACOBIAN: f32 = 1e-4;

/// The entry of a grid node.
fn entry(level: &LevelLayout, node: [u64; 3]) -> usize {
    let [x, y, z] = node;
    let side = u64::from(level.resolution) + 1;
    let of = |x, y, z| x ^ (y * 2_654_435_761) ^ (z * 805_459_861);
    let index = if let Some(hash) = level.hash {
        let hashed = match hash {
            Hash::Nodes => of(x, y, z),
            Hash::Blocks => 8 * of(x / 2, y / 2, z / 2) + x % 2 + 2 * (y % 2) + 4 * (z % 2),
        };
        hashed % level.entries as u64
    } else {
        x + side * (y + side * z)
    };
    level.offset + index as usize
}

/// Feature `f` of a level at a point, by the definition.
fn textbook(layout: &GridLayout, level: usize, f: usize, table: &[f32], point: [f64; 3]) -> f64 {
    let smooth = layout.interpolation == Interpolation::Smoothstep;
    let level = &layout.levels[level];
    let r = f64::from(level.resolution);
    let cell = point.map(|p| (p * r).floor().min(r - 1.0));
    let mut sum = 0.0;
    for corner in 0..8_u64 {
        let mut weight = 1.0;
        let mut node = [0; 3];
        for axis in 0..3 {
            let upper = corner >> axis & 1;
            let t = point[axis] * r - cell[axis];
            let t = if smooth { t * t * (3.0 - 2.0 * t) } else { t };
            weight *= if upper == 1 { t } else { 1.0 - t };
            node[axis] = cell[axis] as u64 + upper;
        }
        sum += weight * f64::from(table[2 * entry(level, node) + f]);
    }
    sum
}

/// Values `[2 L][p]` and Jacobian `[2 L][3][p]` of points, repeated up to a multiple of 16.
fn kernel(
    layout: &GridLayout,
    active: usize,
    table: &[f32],
    points: &[[f32; 3]],
) -> (usize, Vec<f32>, Vec<f32>) {
    let p = points.len().next_multiple_of(16);
    let axis = |a: usize| -> Vec<f32> { (0..p).map(|i| points[i % points.len()][a]).collect() };
    let (mut values, mut jacobian) = (
        vec![f32::NAN; layout.features() * p],
        vec![f32::NAN; layout.features() * 3 * p],
    );
    let (x, y, z) = (axis(0), axis(1), axis(2));
    cpu::encode_tile(
        layout,
        active,
        table,
        &x,
        &y,
        &z,
        &mut values,
        Some(&mut jacobian),
    );
    let mut alone = vec![f32::NAN; values.len()];
    cpu::encode_tile(layout, active, table, &x, &y, &z, &mut alone, None);
    assert_eq!(alone, values);
    for level in 0..active {
        cpu::fetch(cpu::level_values(layout, level, table));
        let (mut own, mut slopes) = (vec![f32::NAN; 2 * p], vec![f32::NAN; 6 * p]);
        let position = [&x[..], &y[..], &z[..]];
        cpu::encode_level(layout, level, table, position, &mut own, Some(&mut slopes));
        assert_eq!(own, values[2 * level * p..][..2 * p], "level {level}");
        assert_eq!(slopes, jacobian[6 * level * p..][..6 * p], "level {level}");
    }
    (p, values, jacobian)
}

#[test]
fn values_and_finite_differences_in_double_precision() {
    for config in smalls() {
        let layout = GridLayout::new(&config);
        let mut random = Random(1);
        let table = random.signed(2 * layout.entries());
        // Multiples of 2^-12: times a resolution of 6 bits they are exact in f32, so that both
        // precisions find the same cell.
        let mut coordinate = || (random.unit() * 4096.0).floor() / 4096.0;
        let points: Vec<[f32; 3]> = (0..64)
            .map(|_| [coordinate(), coordinate(), coordinate()])
            .collect();
        let (p, values, jacobian) = kernel(&layout, 6, &table, &points);
        let mut compared = 0;
        for (i, point) in points.iter().enumerate() {
            let point = point.map(f64::from);
            for k in 0..12 {
                let at = |point| textbook(&layout, k / 2, k % 2, &table, point);
                assert!(worst(&[values[k * p + i]], &[at(point) as f32], VALUE) < 1.0);
                let r = f64::from(layout.levels[k / 2].resolution);
                for axis in 0..3 {
                    let step = 1e-6;
                    let (mut low, mut high) = (point, point);
                    low[axis] -= step;
                    high[axis] += step;
                    // A trilinear derivative jumps at a border: only differences within a cell.
                    let smooth = config.interpolation == Interpolation::Smoothstep;
                    let inside = low[axis] >= 0.0 && high[axis] <= 1.0;
                    let same = (low[axis] * r).floor() == (high[axis] * r).floor();
                    if inside && (same || smooth) {
                        let slope = (at(high) - at(low)) / (2.0 * step);
                        let found = jacobian[(3 * k + axis) * p + i];
                        assert!(worst(&[found], &[slope as f32], JACOBIAN) < 1.0);
                        compared += 1;
                    }
                }
            }
        }
        assert!(
            compared > 2000,
            "only {compared} of 2304 differences were inside a cell"
        );
    }
}

#[test]
fn nodes_have_their_entries_values() {
    for hash in [Hash::Nodes, Hash::Blocks] {
        nodes_have_their_entries_values_with(hash);
    }
}

fn nodes_have_their_entries_values_with(hash: Hash) {
    let layout = GridLayout::new(&GridConfig {
        hash,
        ..small(Interpolation::Linear)
    });
    let table = Random(2).signed(2 * layout.entries());
    for (l, level) in layout.levels.iter().enumerate() {
        let r = level.resolution;
        for node in [
            [0, 0, 0],
            [r, r, r],
            [0, r, 1],
            [r / 2, 1, r],
            [r - 1, r - 1, r - 1],
        ] {
            let point = node.map(|i| i as f32 / r as f32);
            let (p, values, jacobian) = kernel(&layout, 6, &table, &[point]);
            assert!(
                jacobian
                    .iter()
                    .chain(&values)
                    .all(|value| value.is_finite())
            );
            // i / r is rounded to f32: off by 2^-24 of the box, so by r times that in the cell.
            let tolerance = VALUE + 4.0 * r as f32 / (1 << 24) as f32;
            for f in 0..2 {
                let expected = table[2 * entry(level, node.map(u64::from)) + f];
                let found = values[(2 * l + f) * p];
                assert!((found - expected).abs() < tolerance, "{found} {expected}");
            }
        }
    }
}

#[test]
fn outside_is_clamped_without_slope_and_nan_counts_as_zero() {
    for config in smalls() {
        let layout = GridLayout::new(&config);
        let table = Random(3).signed(2 * layout.entries());
        let cases = [
            (-0.5, 0.0),
            (1.5, 1.0),
            (f32::NEG_INFINITY, 0.0),
            (f32::INFINITY, 1.0),
            (f32::MAX, 1.0),
            (f32::NAN, 0.0),
            (-f32::NAN, 0.0),
            (-f32::MIN_POSITIVE, 0.0),
        ];
        for axis in 0..3 {
            for (outside, border) in cases {
                let (mut there, mut here) = ([0.3, 0.6, 0.2], [0.3, 0.6, 0.2]);
                there[axis] = outside;
                here[axis] = border;
                let (p, values, jacobian) = kernel(&layout, 6, &table, &[there, here]);
                for k in 0..12 {
                    assert_eq!(values[k * p], values[k * p + 1]);
                    for other in 0..3 {
                        let row = (3 * k + other) * p;
                        let expected = if other == axis {
                            0.0
                        } else {
                            jacobian[row + 1]
                        };
                        assert_eq!(jacobian[row], expected);
                    }
                }
            }
        }
    }
}

#[test]
fn poison_neither_leaves_the_table_nor_stops_the_scatter() {
    let layout = GridLayout::new(&GridConfig {
        log2_table_size: 14,
        ..Default::default()
    });
    let poison = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        -1e-45,
        1.0,
        1.000_000_1,
        3e38,
    ];
    let x: Vec<f32> = (0..343).map(|i| poison[i % 7]).collect();
    let y: Vec<f32> = (0..343).map(|i| poison[i / 7 % 7]).collect();
    let z: Vec<f32> = (0..343).map(|i| poison[i / 49]).collect();
    let points: Vec<[f32; 3]> = (0..343).map(|i| [x[i], y[i], z[i]]).collect();
    let table = Random(4).signed(2 * layout.entries());
    let (_, values, jacobian) = kernel(&layout, 16, &table, &points);
    assert!(
        values
            .iter()
            .chain(&jacobian)
            .all(|value| value.is_finite())
    );
    let ones = vec![1.0; 343];
    for (l, level) in layout.levels.iter().enumerate() {
        let mut grad = vec![0.0; 2 * level.entries];
        let rows = cpu::ScatterRows {
            position: [&x, &y, &z],
            d_value: [&ones; 2],
            normal_part: Some(([&ones; 2], [&ones; 3])),
            prefetch_offset: 0,
        };
        cpu::scatter_level(&layout, l, &rows, &mut grad, None);
        assert!(grad.iter().all(|value| value.is_finite()));
    }
}

#[test]
fn the_scatter_is_the_transpose_of_the_encoding() {
    // Both are linear in the table: <d, h(T)> + <g n^T, J(T)> = <scatter(d, g, n), T>.
    for config in smalls() {
        let layout = GridLayout::new(&config);
        let mut random = Random(6);
        let table = random.signed(2 * layout.entries());
        for n in [1, 15, 16, 17, 100] {
            let points: Vec<[f32; 3]> = (0..n)
                .map(|_| [random.unit(), random.unit(), random.unit()])
                .collect();
            let (p, values, jacobian) = kernel(&layout, 6, &table, &points);
            let axis = |a: usize| -> Vec<f32> { points.iter().map(|point| point[a]).collect() };
            let [x, y, z] = [0, 1, 2].map(axis);
            let rows: [Vec<f32>; 7] = std::array::from_fn(|_| random.signed(n));
            let [d0, d1, g0, g1, nx, ny, nz] = &rows;
            for (l, level) in layout.levels.iter().enumerate() {
                let (mut forward, mut size) = (0.0, 0.0);
                let mut add = |a: f32, b: f32| {
                    forward += f64::from(a) * f64::from(b);
                    size += (f64::from(a) * f64::from(b)).abs();
                };
                for i in 0..n {
                    for (f, (d, g)) in [(d0, g0), (d1, g1)].into_iter().enumerate() {
                        let k = 2 * l + f;
                        add(d[i], values[k * p + i]);
                        for (axis, normal) in [nx, ny, nz].into_iter().enumerate() {
                            add(g[i] * normal[i], jacobian[(3 * k + axis) * p + i]);
                        }
                    }
                }
                let mut grad = vec![0.0; 2 * level.entries];
                let mut marked = grad.clone();
                let mut touched = vec![0; level.entries / 8];
                let rows = cpu::ScatterRows {
                    position: [&x, &y, &z],
                    d_value: [d0, d1],
                    normal_part: Some(([g0, g1], [nx, ny, nz])),
                    prefetch_offset: 0,
                };
                cpu::scatter_level(&layout, l, &rows, &mut grad, None);
                // Rows that are asked for and not there do nothing.
                let rows = cpu::ScatterRows {
                    prefetch_offset: 128,
                    ..rows
                };
                cpu::scatter_level(&layout, l, &rows, &mut marked, Some(&mut touched));
                assert_eq!(grad, marked);
                for (block, touched) in grad.chunks_exact(16).zip(&touched) {
                    assert!(*touched == 1 || block.iter().all(|value| *value == 0.0));
                }
                let own = &table[2 * level.offset..2 * (level.offset + level.entries)];
                let back: f64 = grad
                    .iter()
                    .zip(own)
                    .map(|(g, t)| f64::from(*g) * f64::from(*t))
                    .sum();
                // Each term has a relative error of a few f32 roundings.
                assert!(
                    (forward - back).abs() < 1e-5 * (1.0 + size),
                    "{forward} {back} {size}"
                );
            }
        }
    }
}
