//! Numbers from the host as a matrix on any device.

use burn::tensor::{Device, Tensor, TensorData};

/// A matrix of `values` in row-major order, on every device with rows that follow one another: `[rows, columns]`.
///
/// Burn lays a matrix that comes from the host out as the device likes it, which on CUDA is with each row at a multiple of
/// 512 bytes. Kernels that read rows of a few numbers would copy it first, and a table of two features would take 64 times
/// its memory.
///
/// # Panics
/// When the shape's product is not the number of values.
#[must_use]
pub fn matrix(values: Vec<f32>, shape: [usize; 2], device: &Device) -> Tensor<2> {
    assert_eq!(
        values.len(),
        shape[0] * shape[1],
        "matrix: values for the shape {shape:?}"
    );
    let count = values.len();
    if count == 0 {
        // Burn's reshape takes a 0 for "as before".
        return Tensor::from_data(TensorData::new(values, shape), device);
    }
    Tensor::<1>::from_data(TensorData::new(values, [count]), device).reshape(shape)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_follow_one_another() {
        let device = Device::flex();
        let values: Vec<f32> = (0..6).map(|i| i as f32).collect();
        let rows = matrix(values.clone(), [3, 2], &device);
        assert_eq!(rows.dims(), [3, 2]);
        assert_eq!(rows.into_data().as_slice::<f32>().expect("f32"), values);
        for empty in [[0, 4], [3, 0], [0, 0]] {
            assert_eq!(matrix(Vec::new(), empty, &device).dims(), empty);
        }
    }

    #[test]
    #[should_panic(expected = "matrix: values for the shape [2, 2]")]
    fn another_shape_is_refused() {
        let _ = matrix(vec![0.0; 3], [2, 2], &Device::flex());
    }
}
