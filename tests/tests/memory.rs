//! What a view more costs: its pictures, and little else.
#![allow(clippy::unwrap_used)]

use demo_scene::DemoConfig;
use image::imageops::{FilterType::Nearest, resize};
use io_colmap::{MaskSet, Scene};
use peak_alloc::PeakAlloc;
use sos_train::config::{Preset, TrainConfig};
use sos_train::prepare::mask::Mask;
use sos_train::prepare::pixels::PixelStore;
use sos_train::prepare::view::{Lens, load_views};
use sos_train::prepare::{TrainView, prepare};
use sos_train::train::Trainer;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// A photo's size, for which a step's own memory is small beside that of two dozen photos.
const WIDTH: u32 = 640;
const HEIGHT: u32 = 480;
/// Bytes of a photo and its mask.
const PICTURES: usize = (WIDTH * HEIGHT * 4) as usize;
/// Past the start of the object, when both fields are there.
const STEPS: u32 = 30;

fn config() -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.steps = STEPS;
    for setting in [
        "model.levels=6",
        "model.log2_table_size=12",
        "sampling.target_samples=2048",
        "sampling.occupancy_resolution=32",
        "schedule.warmup_steps=5",
    ] {
        config.apply_override(setting).unwrap();
    }
    config.validate().unwrap();
    config
}

/// `count` views of the tiny demo scene, over and over, at the size above and with a mask each.
fn views(count: usize) -> Vec<TrainView> {
    let folder = tempfile::tempdir().unwrap();
    demo_scene::generate(&DemoConfig::tiny())
        .write(folder.path())
        .unwrap();
    let scene = Scene::open(folder.path()).unwrap();
    let masks = MaskSet::find(&folder.path().join("coarse_masks"), &scene, None).unwrap();
    let mut small = load_views(&scene, Some(&masks)).unwrap();
    small.retain(|view| view.mask.is_some());
    let store = PixelStore::new(folder.path());
    let larger = |view: &TrainView| TrainView {
        lens: Lens(view.lens.0.scaled_to(WIDTH, HEIGHT)),
        photo: store
            .keep_photo(resize(&view.photo, WIDTH, HEIGHT, Nearest))
            .unwrap(),
        mask: view
            .mask
            .as_ref()
            .map(|mask| Mask::of_white(&resize(&mask.picture(), WIDTH, HEIGHT, Nearest), &store))
            .transpose()
            .unwrap(),
        ..view.clone()
    };
    small.iter().cycle().take(count).map(larger).collect()
}

/// The most bytes that were in use at once while these views were prepared and trained on.
fn peak(count: usize) -> usize {
    let config = config();
    let views = views(count);
    ALLOCATOR.reset_peak_usage();
    let mut data = prepare(views, &[], &config.prepare, config.loss.ignore_band).unwrap();
    let mut trainer = Trainer::new(&config, &data).unwrap();
    while trainer.step_number() < STEPS {
        trainer.correct_masks(&mut data).unwrap();
        trainer.step(&data);
    }
    ALLOCATOR.peak_usage()
}

#[test]
fn a_view_costs_its_pictures() {
    // Working memory that is kept from step to step is there from now on.
    peak(12);
    let (few, many) = (peak(12), peak(36));
    let growth = many.saturating_sub(few);
    println!(
        "12 views: {:.1} MB, 36 views: {:.1} MB, {:.3} of the pictures between them",
        1e-6 * few as f64,
        1e-6 * many as f64,
        growth as f64 / (24 * PICTURES) as f64
    );
    // A mask takes an eighth of its 8 bits; runs of labels, and the raster of depths, which is as fine as so many
    // rays in all views allow, take a part of the rest.
    let pictures = 24 * PICTURES;
    assert!(growth > pictures / 2, "{growth} bytes");
    assert!(growth < pictures, "{growth} bytes");
}
