//! Occupancy grids: news of cells, and bits.

use burn::tensor::{Device, Int, Tensor, TensorData};
use neus_render::{
    occupancy::{DeviceBits, DeviceOccupancy, OccupancyGrid},
    random::unit_float,
};

use crate::support::{gpu, tensor};

/// A grid with values in [0, 1), some of its cells protected.
fn grid(resolution: u32) -> OccupancyGrid {
    let cells = resolution.pow(3);
    let values = (0..cells).map(|cell| unit_float(1, u64::from(cell)));
    let mut grid = OccupancyGrid::from_values(resolution, 1.0, values.collect())
        .unwrap()
        .with_decay(0.7);
    grid.rebuild_bits(0.5);
    grid.protect((0..cells).filter(|cell| cell % 11 == 3));
    grid
}

fn cells_on(device: &Device, cells: &[u32]) -> Tensor<1, Int> {
    let cells: Vec<i32> = cells.iter().map(|cell| *cell as i32).collect();
    let count = cells.len();
    Tensor::from_data(TensorData::new(cells, [count]), device)
}

fn values(grid: &DeviceOccupancy) -> Vec<f32> {
    grid.values().clone().into_data().try_to_vec().unwrap()
}

fn assert_same_bits(what: &str, found: &DeviceBits, expected: &OccupancyGrid) {
    let words = found.words().clone().into_data();
    let words = words.try_to_vec::<i32>().unwrap();
    assert_eq!(
        words.len(),
        2 * expected.cell_count().div_ceil(64),
        "{what}"
    );
    for i in 0..32 * words.len() {
        let bit = words[i / 32] >> (i % 32) & 1 == 1;
        let exists = i < expected.cell_count();
        let occupied = exists && expected.cell_occupied(i as u32);
        assert_eq!(bit, occupied, "{what}: cell {i}");
    }
}

#[test]
fn cells_are_renewed_as_on_the_cpu() {
    let Some(gpu) = gpu() else {
        return;
    };
    for resolution in [1, 5, 16, 33] {
        let mut here = grid(resolution);
        let mut there = DeviceOccupancy::upload(&here, &gpu);
        assert_same_bits("uploaded", there.bits(), &here);
        for round in 0..3 {
            // Two of three cells, in another order than theirs.
            let cells: Vec<u32> = (0..here.cell_count() as u32)
                .rev()
                .filter(|cell| (cell + round) % 3 != 0)
                .collect();
            let news: Vec<f32> = (0..cells.len() as u64)
                .map(|i| match i % 13 {
                    5 => f32::NAN,
                    8 => f32::INFINITY,
                    9 => -1.0,
                    _ => unit_float(u64::from(round) + 2, i),
                })
                .collect();
            here.update(&cells, &news);
            let device_news = tensor(&news, [news.len()], &gpu);
            there = there.update(cells_on(&gpu, &cells), device_news);
            assert_eq!(values(&there), here.values(), "resolution {resolution}");
            for threshold in [0.3, 0.9] {
                here.rebuild_bits(threshold);
                there = there.rebuild_bits(threshold);
                let what = format!("resolution {resolution}, above {threshold}");
                assert_same_bits(&what, there.bits(), &here);
            }
        }
    }
}

/// News of one cell come in some order, whichever.
#[test]
fn cells_may_be_named_more_than_once() {
    let Some(gpu) = gpu() else {
        return;
    };
    let here = grid(10);
    let (count, times) = (here.cell_count(), 3);
    let cells: Vec<u32> = (0..times * count).map(|i| (i % count) as u32).collect();
    let news: Vec<f32> = (0..cells.len() as u64)
        .map(|i| unit_float(9, i) * 0.8)
        .collect();
    let there = DeviceOccupancy::upload(&here, &gpu);
    let there = there.update(cells_on(&gpu, &cells), tensor(&news, [news.len()], &gpu));
    let found = values(&there);
    let orders = [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ];
    for cell in 0..count {
        let possible = orders.map(|order| {
            let mut one = here.clone();
            for turn in order {
                one.update(&[cell as u32], &[news[turn * count + cell]]);
            }
            one.values()[cell]
        });
        assert!(
            possible.contains(&found[cell]),
            "cell {cell}: {} is none of {possible:?}",
            found[cell]
        );
    }
}

#[test]
fn news_of_no_cell_change_nothing() {
    let Some(gpu) = gpu() else {
        return;
    };
    let here = grid(5);
    let there = DeviceOccupancy::upload(&here, &gpu);
    let there = there.update(cells_on(&gpu, &[]), tensor(&[], [0], &gpu));
    let nowhere = [125, u32::MAX, 1 << 31];
    let there = there.update(cells_on(&gpu, &nowhere), tensor(&[9.0; 3], [3], &gpu));
    assert_eq!(values(&there), here.values());
}

/// A copy stays as it is while the other is renewed.
#[test]
fn copies_have_values_of_their_own() {
    let Some(gpu) = gpu() else {
        return;
    };
    let here = grid(7);
    let before = DeviceOccupancy::upload(&here, &gpu);
    let after = before
        .clone()
        .update(cells_on(&gpu, &[4]), tensor(&[3.0], [1], &gpu));
    assert_eq!(values(&before), here.values());
    assert_eq!(values(&after)[4], 3.0);
}
