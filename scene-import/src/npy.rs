//! Numpy's arrays, alone (`.npy`) and in archives (`.npz`): numbers of any kind, as `f64`.
//!
//! The format is a line of text and then the numbers; the crates that read it bring a parser
//! generator along.

use crate::error::{ImportError, load};
use half::f16;
use std::collections::BTreeMap;
use std::io::{Cursor, Read as _};
use std::path::Path;

/// Arrays of poses are small; anything larger is a mistake or an attack.
const LARGEST: u64 = 64 << 20;

/// An array in row-major order.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Array {
    pub(crate) shape: Vec<usize>,
    pub(crate) values: Vec<f64>,
}

/// Reads a `.npy` file.
pub(crate) fn read_npy(path: &Path) -> Result<Array, ImportError> {
    parse(&load(path)?).map_err(|what| damaged(path, what))
}

/// Reads those arrays of a `.npz` file that are wanted by name. Others may hold what they like, such as texts.
pub(crate) fn read_npz(
    path: &Path,
    wanted: impl Fn(&str) -> bool,
) -> Result<BTreeMap<String, Array>, ImportError> {
    let bytes = load(path)?;
    let mut archive =
        zip::ZipArchive::new(Cursor::new(bytes)).map_err(|e| damaged(path, e.to_string()))?;
    let mut arrays = BTreeMap::new();
    let mut total = 0;
    for i in 0..archive.len() {
        let full = archive.name_for_index(i).transpose();
        let full = full.map_err(|e| damaged(path, e.to_string()))?;
        let name = full.as_deref().and_then(|full| full.strip_suffix(".npy"));
        let Some(name) = name.filter(|name| wanted(name)).map(str::to_owned) else {
            continue;
        };
        let file = archive
            .by_index(i)
            .map_err(|e| damaged(path, e.to_string()))?;
        let mut bytes = Vec::new();
        // The stated size is not to be trusted.
        file.take(LARGEST + 1)
            .read_to_end(&mut bytes)
            .map_err(|e| damaged(path, format!("{name} cannot be unpacked ({e})")))?;
        total += bytes.len() as u64;
        if total > LARGEST {
            return Err(damaged(
                path,
                format!("it unpacks to more than {LARGEST} bytes"),
            ));
        }
        let array = parse(&bytes).map_err(|what| damaged(path, format!("{name}: {what}")))?;
        arrays.insert(name, array);
    }
    Ok(arrays)
}

fn damaged(path: &Path, what: impl Into<String>) -> ImportError {
    ImportError::bad(
        path,
        what,
        "save it again with numpy, its numbers as float64",
    )
}

fn parse(bytes: &[u8]) -> Result<Array, String> {
    let ends = || "the file is cut off".to_owned();
    let rest = bytes
        .strip_prefix(b"\x93NUMPY")
        .ok_or("this is no numpy file")?;
    let (&[major, _], rest) = rest.split_first_chunk::<2>().ok_or_else(ends)?;
    let (length, rest) = if major < 2 {
        let (length, rest) = rest.split_first_chunk::<2>().ok_or_else(ends)?;
        (usize::from(u16::from_le_bytes(*length)), rest)
    } else {
        let (length, rest) = rest.split_first_chunk::<4>().ok_or_else(ends)?;
        (u32::from_le_bytes(*length) as usize, rest)
    };
    let (header, data) = rest.split_at_checked(length).ok_or_else(ends)?;
    let header = std::str::from_utf8(header).map_err(|_| "the header is not text")?;
    let descr = field(header, "descr")
        .and_then(|value| value.split(['\'', '"']).nth(1))
        .ok_or("the header names no number type")?;
    let column_major = field(header, "fortran_order").is_some_and(|v| v.starts_with("True"));
    let shape = field(header, "shape")
        .and_then(|value| value.strip_prefix('(')?.split(')').next())
        .ok_or("the header names no shape")?
        .split(',')
        .map(str::trim)
        .filter(|part| !part.is_empty())
        .map(|part| part.trim_end_matches('L').parse::<usize>())
        .collect::<Result<Vec<_>, _>>()
        .map_err(|_| "the shape is not readable")?;

    let (size, number) = number_type(descr)?;
    let count = shape
        .iter()
        .try_fold(1_usize, |n, &d| n.checked_mul(d))
        .ok_or("the shape is absurd")?;
    if count.checked_mul(size) != Some(data.len()) {
        return Err(format!(
            "the shape {shape:?} needs {count} numbers of {size} bytes, but {} bytes follow",
            data.len()
        ));
    }
    let values: Vec<f64> = data.chunks_exact(size).map(number).collect();
    let values = if column_major {
        row_major(&values, &shape)
    } else {
        values
    };
    Ok(Array { shape, values })
}

/// The text after `'key':` in the header's dictionary.
fn field<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let at = header.find(&format!("'{key}'"))? + key.len() + 2;
    Some(header[at..].trim_start().strip_prefix(':')?.trim_start())
}

type Number = fn(&[u8]) -> f64;

/// Size in bytes and reader of a type such as `<f8`.
fn number_type(descr: &str) -> Result<(usize, Number), String> {
    macro_rules! number {
        ($t:ty, $from:ident) => {
            (size_of::<$t>(), |bytes| {
                let mut own = [0; size_of::<$t>()];
                own.copy_from_slice(bytes);
                <$t>::$from(own) as f64
            })
        };
    }
    Ok(match descr {
        "<f8" | "=f8" => number!(f64, from_le_bytes),
        ">f8" => number!(f64, from_be_bytes),
        "<f4" | "=f4" => number!(f32, from_le_bytes),
        ">f4" => number!(f32, from_be_bytes),
        "<f2" | "=f2" => (2, |bytes| f16::from_le_bytes([bytes[0], bytes[1]]).to_f64()),
        "<i8" => number!(i64, from_le_bytes),
        "<i4" => number!(i32, from_le_bytes),
        "<i2" => number!(i16, from_le_bytes),
        "<u8" => number!(u64, from_le_bytes),
        "<u4" => number!(u32, from_le_bytes),
        "<u2" => number!(u16, from_le_bytes),
        "|u1" | "|b1" => number!(u8, from_le_bytes),
        "|i1" => number!(i8, from_le_bytes),
        other => return Err(format!("numbers of type {other:?} are not known")),
    })
}

/// Reorders column-major values.
fn row_major(values: &[f64], shape: &[usize]) -> Vec<f64> {
    (0..values.len())
        .map(|i| {
            // The index along each axis, the last axis fastest; then the place with the first fastest.
            let (mut rest, mut indices) = (i, Vec::with_capacity(shape.len()));
            for &d in shape.iter().rev() {
                indices.push(rest % d);
                rest /= d;
            }
            let at = indices
                .iter()
                .zip(shape.iter().rev())
                .fold(0, |at, (&index, &d)| at * d + index);
            values[at]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn both_orders_and_several_types_are_read() {
        let floats: Vec<u8> = [1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let rows = file(
            "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }\n",
            &floats,
        );
        let array = parse(&rows).unwrap();
        assert_eq!(
            (array.shape, array.values),
            (vec![2, 3], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
        );
        let columns = file(
            "{'descr': '<f4', 'fortran_order': True, 'shape': (2, 3), }",
            &floats,
        );
        assert_eq!(
            parse(&columns).unwrap().values,
            [1.0, 3.0, 5.0, 2.0, 4.0, 6.0]
        );
        let scalar = file(
            "{'descr': '>f8', 'fortran_order': False, 'shape': ()}",
            &7.5_f64.to_be_bytes(),
        );
        assert_eq!(
            parse(&scalar).unwrap(),
            Array {
                shape: vec![],
                values: vec![7.5]
            }
        );
    }

    #[test]
    fn seldom_types_are_read_too() {
        let read = |descr: &str, data: &[u8]| {
            let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (2,)}}");
            parse(&file(&header, data)).unwrap().values
        };
        // 1.5 and -2.
        assert_eq!(read("<f2", &[0x00, 0x3e, 0x00, 0xc0]), [1.5, -2.0]);
        assert_eq!(read("|b1", &[1, 0]), [1.0, 0.0]);
        let large = [1_u64 << 40, 7].map(u64::to_le_bytes).concat();
        assert_eq!(read("<u8", &large), [(1_u64 << 40) as f64, 7.0]);
    }

    #[test]
    fn damage_is_an_error() {
        let good = file(
            "{'descr': '|u1', 'fortran_order': False, 'shape': (3,)}",
            &[1, 2, 3],
        );
        assert!(parse(&good).is_ok());
        for length in 0..good.len() {
            assert!(parse(&good[..length]).is_err(), "{length}");
        }
        for header in [
            "{'descr': '|u1', 'fortran_order': False, 'shape': (99999999999999999999,)}",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (4294967296, 4294967296)}",
            "{'descr': '|O', 'fortran_order': False, 'shape': (3,)}",
            "{'fortran_order': False, 'shape': (3,)}",
            "{'descr': '|u1'}",
            "",
        ] {
            assert!(parse(&file(header, &[1, 2, 3])).is_err(), "{header}");
        }
    }
}
