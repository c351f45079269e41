//! Scores a segmenter on photos whose true mattes are known; this one takes what is as red as the
//! middle of the picture: `cargo run --release -p demo-scene --example measure_a_segmenter`.

use demo_scene::{DemoConfig, DemoView, generate};
use image::RgbImage;

/// Whether each pixel is of the object: as the colour at the photo's middle, nearly.
fn segment(photo: &RgbImage) -> Vec<bool> {
    let (width, height) = photo.dimensions();
    let middle = photo.get_pixel(width / 2, height / 2).0;
    let near = |pixel: &image::Rgb<u8>| {
        let off = pixel.0.iter().zip(middle).map(|(a, b)| a.abs_diff(b));
        off.map(u32::from).sum::<u32>() < 120
    };
    photo.pixels().map(near).collect()
}

/// Intersection over union with the true matte at a half.
fn iou(mask: &[bool], view: &DemoView) -> f64 {
    let truth = view.alpha.as_raw().iter().map(|alpha| *alpha >= 128);
    let (mut both, mut any) = (0, 0);
    for (found, true_one) in mask.iter().zip(truth) {
        both += u32::from(*found && true_one);
        any += u32::from(*found || true_one);
    }
    f64::from(both) / f64::from(any.max(1))
}

fn main() {
    let scene = generate(&DemoConfig::tiny());
    let mut sum = 0.0;
    for view in &scene.views {
        let score = iou(&segment(&view.photo), view);
        sum += score;
        println!("{}: IoU {score:.2}", view.name);
    }
    println!(
        "mean IoU {:.2}; the scene's own flawed masks have {:.2}",
        sum / scene.views.len() as f64,
        scene.mean_coarse_iou()
    );
}
