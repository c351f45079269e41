//! The real programs on the demo scene; skipped where they are not installed.

use demo_scene::{DemoConfig, generate};
use io_colmap::{Model, Scene};
use scene_capture::{CaptureOptions, Colmap, Ffmpeg, Source, Tools, capture, detect};
use std::path::Path;
use std::process::Command;

/// Renders photos of the demo scene, and the model with its true poses.
fn render(dir: &Path, views: usize) -> Model {
    let config = DemoConfig {
        views,
        mesh_cell: 0.01,
        ..DemoConfig::default()
    };
    generate(&config).write(dir).unwrap();
    Scene::open(dir).unwrap().model
}

fn found(what: &str, error: Option<impl std::fmt::Display>) -> bool {
    if let Some(error) = &error {
        eprintln!("skipped: {what}: {error}");
    }
    error.is_none()
}

/// The largest relative error of distances between cameras, after the best common scale.
fn worst_distance(truth: &Model, found: &Model) -> f64 {
    let centres: Vec<_> = found
        .views
        .iter()
        .map(|view| {
            let same = truth.views.iter().find(|other| other.name == view.name);
            (
                view.camera_from_world.centre(),
                same.unwrap().camera_from_world.centre(),
            )
        })
        .collect();
    let mut pairs = Vec::new();
    for (i, a) in centres.iter().enumerate() {
        for b in &centres[..i] {
            pairs.push((a.0.distance(b.0), a.1.distance(b.1)));
        }
    }
    let scale = pairs.iter().map(|p| p.1).sum::<f64>() / pairs.iter().map(|p| p.0).sum::<f64>();
    let spread = pairs.iter().map(|p| p.1).fold(0.0, f64::max);
    pairs
        .iter()
        .map(|p| (scale * p.0 - p.1).abs() / spread)
        .fold(0.0, f64::max)
}

#[test]
fn colmap_finds_the_poses_that_the_demo_was_rendered_from() {
    let colmap = Colmap::find();
    if !found("COLMAP on rendered photos", colmap.as_ref().err()) {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let truth = render(&dir.path().join("demo"), 14);
    let photos = dir.path().join("photos");
    std::fs::rename(dir.path().join("demo/images"), &photos).unwrap();
    let source = detect(&photos).unwrap();
    let tools = Tools {
        colmap: colmap.unwrap(),
        ffmpeg: None,
    };
    let out = dir.path().join("scene");
    let captured = capture(&source, &out, &tools, &CaptureOptions::default(), &()).unwrap();
    println!("{captured:?}");
    assert!(captured.registered >= 12, "{captured:?}");
    let worst = worst_distance(&truth, &Scene::open(&out).unwrap().model);
    println!("the worst distance between cameras is off by {worst:.4} of the largest");
    // The lens is estimated from 14 small photos.
    assert!(worst < 0.03, "{worst}");
}

/// Three seconds of a pattern that moves.
const PATTERN: &str = "-f lavfi -i testsrc=size=320x240:rate=20 -t 3";

/// Writes a video with the installed ffmpeg; says so where it cannot.
fn made(dir: &Path, arguments: &str) -> bool {
    let done = Command::new("ffmpeg")
        .current_dir(dir)
        .args(["-v", "error", "-nostdin"])
        .args(arguments.split(' '))
        .status();
    let made = done.unwrap().success();
    if !made {
        eprintln!("skipped: this ffmpeg cannot write the video of the test");
    }
    made
}

#[test]
fn frames_are_taken_from_a_real_video_turned_as_players_do() {
    let ffmpeg = Ffmpeg::find();
    if !found("ffmpeg on a generated video", ffmpeg.as_ref().err()) {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let (plain, turned) = (dir.path().join("plain.mp4"), dir.path().join("turned.mp4"));
    let turn = "-i plain.mp4 -c copy -metadata:s:v:0 rotate=90 turned.mp4";
    if !made(dir.path(), &format!("{PATTERN} plain.mp4")) || !made(dir.path(), turn) {
        return;
    }
    let ffmpeg = ffmpeg.unwrap();
    for video in [&plain, &turned] {
        let info = ffmpeg.probe(video).unwrap();
        assert!(
            (info.seconds - 3.0).abs() < 0.2 && (info.rate - 20.0).abs() < 0.1,
            "{info:?}"
        );
        let frames = video.with_extension("frames");
        std::fs::create_dir(&frames).unwrap();
        let options = CaptureOptions::default().frames;
        let taken = ffmpeg.take_frames(video, &frames, &options, &()).unwrap();
        println!("{info:?}: {taken:?}");
        assert!((10..=12).contains(&taken.frames), "{taken:?}");
        let first = image::open(frames.join("frame_00001.jpg")).unwrap();
        // Newer versions of ffmpeg do not write the sign of turning that way: then nothing is
        // turned, but both must say so.
        assert_eq!((first.width(), first.height()), info.size);
    }
    assert_eq!(detect(&plain), Some(Source::Video(plain)));
}

#[test]
fn frames_are_taken_from_a_video_of_ten_bits() {
    let ffmpeg = Ffmpeg::find();
    if !found("ffmpeg on a video of ten bits", ffmpeg.as_ref().err()) {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let deep = format!("{PATTERN} -pix_fmt yuv420p10le -c:v ffv1 deep.mkv");
    if !made(dir.path(), &deep) {
        return;
    }
    let frames = dir.path().join("frames");
    std::fs::create_dir(&frames).unwrap();
    let options = CaptureOptions::default().frames;
    let video = dir.path().join("deep.mkv");
    let taken = ffmpeg.unwrap().take_frames(&video, &frames, &options, &());
    let taken = taken.unwrap();
    assert!((10..=12).contains(&taken.frames), "{taken:?}");
    let first = image::open(frames.join("frame_00001.jpg")).unwrap();
    assert_eq!((first.width(), first.height()), (320, 240));
}

#[test]
fn frames_of_an_interlaced_video_show_one_moment() {
    let ffmpeg = Ffmpeg::find();
    if !found("ffmpeg on an interlaced video", ffmpeg.as_ref().err()) {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    // What is seen moves sideways by ten pixels between the rows of a picture.
    let moving = "-f lavfi -i testsrc2=size=320x240:rate=50 -t 3 \
        -vf scroll=h=0.03,tinterlace=interleave_top,setfield=tff \
        -flags +ilme+ildct -c:v mpeg2video -q:v 2 rows.mpg";
    if !made(dir.path(), moving) {
        return;
    }
    let frames = dir.path().join("frames");
    std::fs::create_dir(&frames).unwrap();
    let options = CaptureOptions::default().frames;
    let video = dir.path().join("rows.mpg");
    let taken = ffmpeg.unwrap().take_frames(&video, &frames, &options, &());
    let taken = taken.unwrap();
    assert!(
        taken.notes.iter().any(|note| note.contains("interlaced")),
        "{taken:?}"
    );
    let first = image::open(frames.join("frame_00001.jpg")).unwrap();
    let first = first.into_luma8();
    // Rows of another moment differ more from their neighbours than from those beyond.
    let difference = |apart: u32| -> u64 {
        let rows = 2..first.height();
        let pairs = rows.flat_map(|y| (0..first.width()).map(move |x| [(x, y), (x, y - apart)]));
        let differences = pairs.map(|[a, b]| {
            let [a, b] = [a, b].map(|(x, y)| first.get_pixel(x, y).0[0]);
            u64::from(a.abs_diff(b))
        });
        differences.sum()
    };
    assert!(difference(1) < difference(2), "{taken:?}");
}
