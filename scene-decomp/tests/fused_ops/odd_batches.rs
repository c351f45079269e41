//! Batches of no points, of very many, and with points that are no numbers.

use std::sync::Arc;

use burn::tensor::Device;
use hashgrid::GridLayout;
use scene_decomp::FrozenSurface;
use scene_decomp::colour_field::{self, ColourFieldInputs};

use crate::{config, numbers, surface, tensor, values};

#[test]
fn no_points_give_no_rows() {
    let device = Device::flex().autodiff();
    let surface = surface(&device);
    let layout = Arc::new(GridLayout::new(&config().grid));
    let empty = tensor(Vec::new(), [0, 3], &device);
    let out = surface.geometry(empty, surface.sdf_config(&layout, 5, None));
    assert_eq!(out.dims(), [0, 11]);
    let samples = surface.sample(&[], &[], &[], surface.sdf_config(&layout, 5, None));
    assert_eq!(samples.geometry.dims(), [0, 11]);
    assert_eq!(samples.colour.dims(), [0, 4]);
}

/// Gradients of an empty geometry add up, whatever else it went into.
#[test]
fn no_points_give_gradients_of_their_shape() {
    for device in [Device::flex(), Device::ndarray()] {
        let device = &device.autodiff();
        let none = |columns| tensor(Vec::new(), [0, columns], device);
        let geometry = none(11).require_grad();
        let inputs = ColourFieldInputs {
            geometry: geometry.clone(),
            points: none(3),
            directions: none(3),
            extra: none(1),
        };
        let colours = colour_field::colour_field(inputs, surface(device).colour_weights());
        let grads = (colours.sum() + geometry.clone().sum()).backward();
        assert_eq!(geometry.grad(&grads).unwrap().dims(), [0, 11]);
    }
}

/// As zero, what is no number would go unnoticed in the loss and spoil the weights' gradients.
#[test]
fn geometry_that_is_no_number_gives_a_colour_that_is_none() {
    for device in [Device::flex(), Device::ndarray()] {
        let device = &device.autodiff();
        let (n, spoilt) = (130, 70);
        let mut geometry = numbers(11 * n, 61);
        geometry[11 * spoilt + 5] = f32::NAN;
        let inputs = ColourFieldInputs {
            geometry: tensor(geometry, [n, 11], device),
            points: tensor(numbers(3 * n, 62), [n, 3], device),
            directions: tensor(numbers(3 * n, 63), [n, 3], device),
            extra: tensor(numbers(n, 64), [n, 1], device),
        };
        let colours = colour_field::colour_field(inputs, surface(device).colour_weights());
        for (row, colour) in values(colours).chunks_exact(4).enumerate() {
            let is_none = colour.iter().all(|value| value.is_nan());
            assert!(is_none == (row == spoilt), "{row}: {colour:?}");
        }
    }
}

#[test]
fn any_number_of_points_can_be_asked_about() {
    // More than are asked about at once: those of a photo are.
    let device = Device::flex().autodiff();
    let layout = Arc::new(GridLayout::new(&config().grid));
    let frozen = FrozenSurface::new(&surface(&device), &layout, 5);
    let n = (1 << 16) + 3;
    let points = numbers(3 * n, 9);
    let (directions, extra) = (numbers(3 * n, 10), numbers(n, 11));
    let geometry = frozen.geometry(&points);
    let distances = frozen.distances_of(points.clone());
    let gradients = frozen.gradients_of(points.clone());
    let colours = frozen.colour(&geometry, &points, &directions, &extra);
    assert_eq!(
        (distances.len(), gradients.len(), colours.len()),
        (n, n, 4 * n)
    );
    for i in [0, n - 4, n - 3, n - 1] {
        let of = |rows: &[f32], columns: usize| rows[columns * i..columns * (i + 1)].to_vec();
        let own = frozen.geometry(&of(&points, 3));
        assert_eq!(own.values, of(&geometry.values, geometry.columns));
        assert_eq!(distances[i], own.values[0]);
        assert_eq!(gradients[i], own.normal(0));
        let colour = frozen.colour(&own, &of(&points, 3), &of(&directions, 3), &of(&extra, 1));
        assert_eq!(colour, of(&colours, 4));
    }
}
