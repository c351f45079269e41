//! The ops on each backend against the plain tensor reference: values, Jacobians, gradients.
#![allow(missing_docs, clippy::unwrap_used, deprecated)]

mod support;

use std::sync::Arc;

use burn::Tensor;
use burn::tensor::{Device, TensorData};
use hashgrid::{GridConfig, GridLayout, Hash, encode, encode_with_jacobian, reference};
use support::{Random, small, smalls, worst};

/// Entries are of size 1, weights add up to 1, and cells are located by the same f32 arithmetic:
/// what differs is the order of some ten roundings.
const VALUE: f32 = 2e-6;
/// A derivative is a difference of entries times a resolution of up to 61.
const JACOBIAN: f32 = 1e-4;
/// An entry of the coarsest level is the sum of some hundred points' terms.
const GRADIENT: f32 = 1e-4;
/// A point's gradient is a sum over all features of Jacobian entries.
const POINT_GRADIENT: f32 = 1e-4;

fn devices() -> [Device; 2] {
    [Device::flex(), Device::ndarray()]
}

fn matrix(values: Vec<f32>, columns: usize, device: &Device) -> Tensor<2> {
    let rows = values.len() / columns;
    Tensor::from_data(TensorData::new(values, [rows, columns]), device)
}

fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().to_vec().unwrap()
}

struct Case {
    layout: Arc<GridLayout>,
    points: Vec<f32>,
    table: Vec<f32>,
}

impl Case {
    fn new(config: &GridConfig, n: usize) -> Self {
        let layout = Arc::new(GridLayout::new(config));
        let mut random = Random(n as u64 + 5);
        let table = random.signed(2 * layout.entries());
        Self {
            points: random.units(3 * n),
            table,
            layout,
        }
    }

    fn tensors(&self, device: &Device) -> (Tensor<2>, Tensor<2>) {
        (
            matrix(self.points.clone(), 3, device),
            matrix(self.table.clone(), 2, device),
        )
    }
}

#[test]
fn values_and_jacobians_are_the_references() {
    for device in devices() {
        for config in smalls() {
            for n in [1, 17, 1000] {
                for active in [0, 1, 4, 6] {
                    let case = Case::new(&config, n);
                    let (points, table) = case.tensors(&device);
                    let (p, t) = (points.clone(), table.clone());
                    let alone = values(encode(p, t, &case.layout, active));
                    let (p, t) = (points.clone(), table.clone());
                    let (h, j) = encode_with_jacobian(p, t, &case.layout, active);
                    assert_eq!(h.dims(), [n, 12]);
                    assert_eq!(j.dims(), [n, 12, 3]);
                    let (h, j) = (values(h), values(j));
                    assert_eq!(alone, h);
                    let (rh, rj) =
                        reference::encode_with_jacobian(points, table, &case.layout, active);
                    assert!(worst(&h, &values(rh), VALUE) < 1.0);
                    assert!(worst(&j, &values(rj), JACOBIAN) < 1.0);
                    for row in h.chunks_exact(12) {
                        assert!(row[2 * active..].iter().all(|value| *value == 0.0));
                    }
                    for row in j.chunks_exact(36) {
                        assert!(row[6 * active..].iter().all(|value| *value == 0.0));
                    }
                }
            }
        }
    }
}

#[test]
fn grids_of_the_papers_size_are_hashed_as_the_reference_does() {
    for hash in [Hash::Nodes, Hash::Blocks] {
        let config = GridConfig {
            hash,
            ..Default::default()
        };
        let case = Case::new(&config, 17);
        let device = Device::flex();
        let (points, table) = case.tensors(&device);
        let found = values(encode(points.clone(), table.clone(), &case.layout, 16));
        let expected = values(reference::encode(points, table, &case.layout, 16));
        assert!(worst(&found, &expected, VALUE) < 1.0);
    }
}

#[test]
fn no_points_give_empty_results() {
    for device in devices() {
        let case = Case::new(&small(Default::default()), 0);
        let (_, table) = case.tensors(&device);
        let points = Tensor::<2>::zeros([0, 3], &device);
        let (h, j) = encode_with_jacobian(points.clone(), table.clone(), &case.layout, 6);
        assert_eq!((h.dims(), j.dims()), ([0, 12], [0, 12, 3]));
        assert_eq!(encode(points, table, &case.layout, 6).dims(), [0, 12]);
    }
}

#[test]
fn gradients_are_the_references() {
    for device in devices().map(Device::autodiff) {
        for config in smalls() {
            for (n, active) in [(1, 6), (17, 4), (1000, 6)] {
                let case = Case::new(&config, n);
                let mut random = Random(99);
                let dh = matrix(random.signed(12 * n), 12, &device);
                let dj = matrix(random.signed(36 * n), 3, &device).reshape([n, 12, 3]);

                // The value's op: by the points and by the table.
                let gradients = |kernel: bool| {
                    let (points, table) = case.tensors(&device);
                    let (points, table) = (points.require_grad(), table.require_grad());
                    let op = if kernel { encode } else { reference::encode };
                    let h = op(points.clone(), table.clone(), &case.layout, active);
                    let grads = (h * dh.clone()).sum().backward();
                    [&points, &table].map(|t| values(t.grad(&grads).unwrap()))
                };
                let ([points, table], [r_points, r_table]) = (gradients(true), gradients(false));
                assert!(worst(&points, &r_points, POINT_GRADIENT) < 1.0);
                assert!(worst(&table, &r_table, GRADIENT) < 1.0);

                // The op with the Jacobian: by the table, through both results.
                let gradient = |kernel: bool| {
                    let (points, table) = case.tensors(&device);
                    let table = table.require_grad();
                    let op = if kernel {
                        encode_with_jacobian
                    } else {
                        reference::encode_with_jacobian
                    };
                    let (h, j) = op(points, table.clone(), &case.layout, active);
                    let loss = (h * dh.clone()).sum() + (j * dj.clone()).sum();
                    values(table.grad(&loss.backward()).unwrap())
                };
                assert!(worst(&gradient(true), &gradient(false), GRADIENT) < 1.0);
            }
        }
    }
}

#[test]
fn points_alone_can_be_tracked() {
    let device = Device::flex().autodiff();
    let case = Case::new(&small(Default::default()), 5);
    let (points, table) = case.tensors(&device);
    let points = points.require_grad();
    let h = encode(points.clone(), table.clone(), &case.layout, 6);
    let grads = h.sum().backward();
    assert!(table.grad(&grads).is_none());
    assert_eq!(points.grad(&grads).unwrap().dims(), [5, 3]);
}

#[test]
fn one_and_two_threads_give_the_same_bits() {
    let device = Device::flex().autodiff();
    let case = Case::new(&small(Default::default()), 3000);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let (points, table) = case.tensors(&device);
            let table = table.require_grad();
            let (h, j) = encode_with_jacobian(points, table.clone(), &case.layout, 6);
            let loss = h.clone().sin().sum() + j.clone().sin().sum();
            let grad = table.grad(&loss.backward()).unwrap();
            let bits = |v: Vec<f32>| v.into_iter().map(f32::to_bits).collect::<Vec<_>>();
            [bits(values(h)), bits(values(j)), bits(values(grad))]
        })
    };
    assert_eq!(run(1), run(2));
}

#[test]
#[should_panic(expected = "encode: points are [4, 2], not [n, 3]")]
fn points_of_the_wrong_shape_are_named() {
    let device = Device::flex();
    let case = Case::new(&small(Default::default()), 1);
    let (_, table) = case.tensors(&device);
    let _ = encode(Tensor::zeros([4, 2], &device), table, &case.layout, 6);
}

#[test]
#[should_panic(expected = "encode_with_jacobian: points are tracked")]
fn tracked_points_are_refused_where_they_get_no_gradient() {
    let device = Device::flex().autodiff();
    let case = Case::new(&small(Default::default()), 1);
    let (points, table) = case.tensors(&device);
    let _ = encode_with_jacobian(points.require_grad(), table, &case.layout, 6);
}
