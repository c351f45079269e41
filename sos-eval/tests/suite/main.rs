//! Every metric against cases done by hand, an independent slow formula, and properties; folders and
//! the command line against what users get wrong; the shared scenes where they are at hand.

#![allow(clippy::unwrap_used)] // a test may panic

mod alpha;
#[cfg(feature = "cli")]
mod cli;
mod folders;
mod image_quality;
mod mesh;
mod plates;
mod shared_scenes;

use sos_eval::Plane;
#[cfg(unix)]
use std::{fs, path::PathBuf};

/// A reproducible plane of smooth blobs, so that masks of it have several components.
fn blobs(width: usize, height: usize, seed: u32) -> Plane {
    let s = seed as f32;
    Plane::from_fn(width, height, |x, y| {
        let (x, y) = (x as f32, y as f32);
        let v = (0.31 * x + 1.3 * s).sin() * (0.23 * y + 0.7 * s).cos()
            + 0.3 * (0.9 * x - 0.6 * y + s).sin();
        (0.5 + 0.7 * v).clamp(0.0, 1.0)
    })
}

/// A disc with an antialiased rim.
fn disc(size: usize, cx: f32, cy: f32, radius: f32) -> Plane {
    Plane::from_fn(size, size, |x, y| {
        (radius + 0.5 - (x as f32 - cx).hypot(y as f32 - cy)).clamp(0.0, 1.0)
    })
}

/// Makes `folders` that nobody may read; `false`, with a printed reason, where this user may read them all the same.
#[cfg(unix)]
fn make_closed(folders: &[PathBuf]) -> bool {
    for folder in folders {
        fs::create_dir_all(folder).unwrap();
    }
    set_mode(folders, 0o000);
    let closed = folders.iter().all(|folder| fs::read_dir(folder).is_err());
    if !closed {
        eprintln!("skipped: this user may read every folder");
    }
    closed
}

/// So that they can be deleted.
#[cfg(unix)]
fn open_again(folders: &[PathBuf]) {
    set_mode(folders, 0o700);
}

#[cfg(unix)]
fn set_mode(folders: &[PathBuf], mode: u32) {
    use std::os::unix::fs::PermissionsExt as _;
    for folder in folders {
        fs::set_permissions(folder, fs::Permissions::from_mode(mode)).unwrap();
    }
}

#[track_caller]
fn assert_near(value: f64, expected: f64, tolerance: f64) {
    assert!(
        (value - expected).abs() <= tolerance,
        "{value} is not {expected} +- {tolerance}"
    );
}
