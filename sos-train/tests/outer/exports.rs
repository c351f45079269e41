//! Every writer read back by another program's code.

use crate::fabricated;
use exr::prelude::{ReadChannels as _, ReadLayers as _};
use glam::DVec3;
use ply_mesh::Mesh;
use sos_train::export::{
    ExportError, LogRecord, TrainLog, ViewRender, check_names, read_log, write_mesh, write_preview,
    write_view,
};
use sos_train::run_folder::{Existing, RunFolder};
use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;
use std::process::Command;

fn run(dir: &Path) -> RunFolder {
    RunFolder::create(&dir.join("run"), Existing::Keep).unwrap()
}

/// Values at the ends, in between, outside, and none at all.
fn odd_view(name: &str) -> ViewRender {
    ViewRender {
        name: name.to_owned(),
        width: 3,
        height: 2,
        alpha: vec![0.0, 1.0, 0.5, -1.0, 7.0, f32::NAN],
        foreground: vec![[0.0, 0.5, 1.0]; 6],
        background: vec![[1.0, f32::NAN, 0.25]; 6],
        seen: vec![0, 1, 2, 3, 254, 255],
        normal: vec![
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.6, 0.8, 0.0],
            [0.0; 3],
        ],
        depth: vec![0.0, 1.5, 1e-6, 12345.678, f32::MAX, 3.0],
    }
}

#[test]
fn pictures_read_back() {
    let dir = tempfile::tempdir().unwrap();
    let run = run(dir.path());
    write_view(&run, &odd_view("left/IMG.0001.JPG")).unwrap();
    let open =
        |folder: &str| image::open(run.root().join(folder).join("left/IMG.0001.png")).unwrap();

    let alpha = open("alpha");
    assert_eq!(alpha.color(), image::ColorType::L16);
    assert_eq!(alpha.to_luma16().into_raw(), [0, 65535, 32768, 0, 65535, 0]);

    let cut_out = open("foreground");
    assert_eq!(cut_out.color(), image::ColorType::Rgba8);
    assert_eq!(cut_out.to_rgba8().get_pixel(2, 0).0, [0, 128, 255, 128]);

    let plate = open("background");
    assert_eq!(plate.color(), image::ColorType::Rgb8);
    assert_eq!(plate.to_rgb8().get_pixel(0, 1).0, [255, 0, 64]);

    let seen = open("background_seen");
    assert_eq!(seen.color(), image::ColorType::L8);
    assert_eq!(seen.to_luma8().into_raw(), [0, 1, 2, 3, 254, 255]);

    let normal = open("normal").to_rgb8();
    assert_eq!(normal.get_pixel(0, 0).0, [0, 0, 0]);
    assert_eq!(normal.get_pixel(1, 0).0, [255, 128, 128]);
    assert_eq!(normal.get_pixel(2, 0).0, [128, 0, 128]);
}

#[test]
fn files_say_what_they_are() {
    let dir = tempfile::tempdir().unwrap();
    let run = run(dir.path());
    write_view(&run, &odd_view("a.png")).unwrap();
    let info = |folder: &str| {
        let file = BufReader::new(File::open(run.root().join(folder).join("a.png")).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        reader.finish().unwrap();
        reader.info().clone()
    };
    for (folder, srgb) in [
        ("alpha", false),
        ("foreground", true),
        ("background", true),
        ("background_seen", false),
        ("normal", false),
    ] {
        assert_eq!(info(folder).srgb.is_some(), srgb, "{folder}");
    }
    let remarks = info("foreground").uncompressed_latin1_text;
    assert!(
        remarks.iter().any(|r| r.text.contains("straight")),
        "{remarks:?}"
    );
}

#[test]
fn depth_reads_back_bit_by_bit() {
    let dir = tempfile::tempdir().unwrap();
    let run = run(dir.path());
    let view = odd_view("a.png");
    write_view(&run, &view).unwrap();
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(run.depth_dir().join("a.exr"))
        .unwrap();
    let layer = &image.layer_data;
    assert_eq!((layer.size.width(), layer.size.height()), (3, 2));
    let channels = &layer.channel_data.list;
    assert_eq!(channels.len(), 1);
    assert_eq!(channels[0].name.to_string(), "Z");
    let exr::prelude::FlatSamples::F32(values) = &channels[0].sample_data else {
        panic!("not 32-bit float");
    };
    assert_eq!(*values, view.depth);
}

#[test]
fn names_cannot_lead_out_of_the_run() {
    let dir = tempfile::tempdir().unwrap();
    let run = run(dir.path());
    for name in ["../../evil.png", "/etc/evil.png", "a\\b\\evil.png"] {
        write_view(&run, &odd_view(name)).unwrap();
    }
    for at in ["evil.png", "etc/evil.png", "a/b/evil.png"] {
        assert!(run.alpha_dir().join(at).is_file(), "{at}");
    }
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
}

#[test]
fn photos_that_differ_only_in_their_ending_are_refused() {
    let folder = Path::new("photos/cat");
    check_names(folder, ["a/1.png", "b/1.png", "2.png"]).unwrap();
    let error = check_names(folder, ["a/1.png", "a/1.jpg"]).unwrap_err();
    assert!(matches!(error, ExportError::SameName { .. }), "{error}");
    assert!(error.to_string().starts_with("photos/cat: "), "{error}");
}

#[test]
fn the_mesh_reads_back() {
    let dir = tempfile::tempdir().unwrap();
    let run = run(dir.path());
    let mesh = Mesh {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::NEG_Z],
        triangles: vec![[0, 1, 2], [3, 1, 0]],
        ..Mesh::default()
    }
    .completed();
    write_mesh(&run, &mesh).unwrap();
    assert_eq!(Mesh::read(&run.mesh_path()).unwrap(), mesh);
    let bytes = fs::read(run.mesh_path()).unwrap();
    assert!(String::from_utf8_lossy(&bytes).contains("comment made by sos "));
}

#[test]
fn previews_are_written() {
    let dir = tempfile::tempdir().unwrap();
    let run = run(dir.path());
    write_preview(&run, 2, 1, &[1, 2, 3, 4, 5, 6]).unwrap();
    assert_eq!(
        image::open(run.preview_path())
            .unwrap()
            .to_rgb8()
            .into_raw(),
        [1, 2, 3, 4, 5, 6]
    );
}

fn record(step: u32) -> LogRecord {
    LogRecord {
        step,
        psnr: f32::NAN,
        ..LogRecord::default()
    }
}

/// The step of each line of a run's log.
fn steps(run: &RunFolder) -> Vec<u64> {
    let lines = read_log(run).unwrap();
    let steps = lines.iter().map(|line| line["step"].as_u64().unwrap());
    steps.collect()
}

#[test]
fn a_resumed_log_forgets_what_will_be_done_again() {
    let dir = tempfile::tempdir().unwrap();
    let run = run(dir.path());
    {
        let mut log = TrainLog::create(&run).unwrap();
        log.note(0, "start").unwrap();
        for step in [10, 20, 30] {
            log.record(&record(step)).unwrap();
        }
        // It has come to its end, but comes to another one when it goes on.
        log.event(20, "end", []).unwrap();
    }
    // A crash in the middle of a line.
    let mut text = fs::read_to_string(run.log_path()).unwrap();
    text.push_str("{\"step\": 15, \"psn");
    fs::write(run.log_path(), text).unwrap();
    {
        let mut log = TrainLog::resume(&run, 20).unwrap();
        log.record(&record(21)).unwrap();
    }
    assert_eq!(steps(&run), [0, 10, 20, 21]);
    assert!(fs::read_to_string(run.log_path()).unwrap().ends_with("}\n"));
}

#[test]
fn a_log_that_goes_back_keeps_what_was_found_out() {
    let dir = tempfile::tempdir().unwrap();
    let run = run(dir.path());
    let mut log = TrainLog::create(&run).unwrap();
    for step in [10, 20, 30] {
        log.record(&record(step)).unwrap();
    }
    log.note(25, "a camera is off").unwrap();
    log.go_back(&run, 20).unwrap();
    log.note(20, "back to step 20").unwrap();
    assert_eq!(steps(&run), [10, 20, 25, 20]);
}

#[test]
fn a_run_of_the_truth_scores_as_the_truth() {
    let dir = tempfile::tempdir().unwrap();
    let (_, run) = fabricated::run(dir.path(), true);
    let scene = run.scene_dir();
    let report = sos_eval::run_eval(run.root(), &scene, Some(&scene.join("coarse_masks"))).unwrap();
    assert!(report.mean.iou > 0.9999, "{report}");
    assert!(report.start.unwrap().iou < 0.9);
    assert!(report.mesh.unwrap().relative.chamfer < 0.01);
}

#[test]
fn options_of_other_targets_are_refused() {
    for (options, says) in [
        (&["--to", "glb", "--fps", "3"][..], "only videos"),
        (&["--masks-for", "neus", "--fps", "3"], "only videos"),
        (&["--to", "glb", "--plain-rle"], "only COCO"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_sos"))
            .args([&["export", "nowhere"], options].concat())
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(says), "{said}");
    }
}
