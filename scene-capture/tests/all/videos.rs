//! A video to a scene, with stand-ins for ffmpeg and COLMAP.

use crate::stand_ins::{Dialect, Listener, Workshop, stripes};
use scene_capture::{CaptureOptions, FrameOptions, Source, Stage, Tools, capture};
use std::fs;
use std::path::Path;

/// Two seconds at ten pictures a second: eight windows, two looks each.
const SECONDS: f64 = 2.0;

#[test]
fn the_sharpest_frames_become_photos() {
    let shop = Workshop::new();
    let video = shop.path("my video.mp4");
    fs::write(&video, "").unwrap();
    // The second look of each window is the sharper; the last three windows show the same.
    let pictures: Vec<_> = (0..16)
        .map(|i| stripes((i / 2).min(5) * 3, if i % 2 == 1 { 100 } else { 40 }))
        .collect();
    let frames: Vec<String> = (1..=6).map(|i| format!("frame_{i:05}.jpg")).collect();
    let names: Vec<&str> = frames.iter().map(String::as_str).collect();
    // Neighbours alone give too little; all pairs give all.
    shop.model(0, 0, &names[..3]);
    shop.model(1, 0, &names);
    let tools = Tools {
        colmap: shop.colmap(Dialect::Four, ""),
        ffmpeg: Some(shop.ffmpeg(&pictures, SECONDS, "echo 'Error: odd packet' >&2")),
    };
    let watch = Listener::default();
    let out = shop.path("scene");
    let options = CaptureOptions::default();
    let captured = capture(&Source::Video(video), &out, &tools, &options, &watch).unwrap();
    assert_eq!((captured.photos, captured.registered), (6, 6));
    for said in [
        "6 frames of 64x48 are taken from 2.0 seconds",
        "nothing had moved since the frame before in 2 of 8 moments",
        "ffmpeg complained about the video: Error: odd packet",
        "comparing neighbours gave poses for 3 of 6 photos",
        "6 of 6 photos have poses",
    ] {
        assert!(
            captured.notes.iter().any(|note| note.starts_with(said)),
            "{captured:?}"
        );
    }
    let told = shop.told();
    let commands: Vec<&str> = told
        .iter()
        .filter_map(|call| call.split(' ').next())
        .collect();
    assert_eq!(
        commands,
        [
            "-hide_banner",
            "feature_extractor",
            "sequential_matcher",
            "mapper",
            "exhaustive_matcher",
            "mapper"
        ]
    );
    assert!(
        told[0].contains("my video.mp4 -map 0:V:0 -vf fps=8.000000,format=rgb24 -f image2pipe")
    );
    for frame in &frames {
        let picture = image::open(out.join("images").join(frame))
            .unwrap()
            .into_luma8();
        assert!(
            *picture.iter().max().unwrap() > 180,
            "{frame} is the sharper one"
        );
    }
    let progress = watch.progress.lock().unwrap();
    let last = progress.iter().rfind(|p| p.stage == Stage::Frames).unwrap();
    assert_eq!((last.done, last.total), (16, 16));
}

#[test]
fn videos_that_show_too_little_are_refused() {
    let shop = Workshop::new();
    let video = shop.path("v.mp4");
    fs::write(&video, "").unwrap();
    let said = |pictures: &[_], end: &str| {
        let ffmpeg = shop.ffmpeg(pictures, SECONDS, end);
        let frames = shop.path("frames");
        fs::create_dir_all(&frames).unwrap();
        ffmpeg
            .take_frames(&video, &frames, &FrameOptions::default(), &())
            .unwrap_err()
            .to_string()
    };
    let still = vec![stripes(0, 90); 16];
    assert!(said(&still, "").contains("v.mp4: nothing moves in it"));
    assert!(said(&still[..2], "").contains("it gives only 1 frames in its 2.0 seconds"));
    assert!(said(&[], "").contains("it gives only 0 frames"));
    let broken = said(
        &still,
        "echo 'moov atom not found, invalid data' >&2; exit 1",
    );
    assert!(
        broken.contains("ffmpeg cannot decode it (moov atom not found, invalid data); copy"),
        "{broken}"
    );
    assert!(said(&[], "echo P5").contains("ffmpeg sent no pictures"));
    assert!(
        said(&[], "printf 'P6 9'").contains("only 0 frames"),
        "cut off"
    );
}

#[test]
fn frames_are_described_as_they_come() {
    let shop = Workshop::new();
    let video = shop.path("v.mp4");
    fs::write(&video, "").unwrap();
    let pictures: Vec<_> = (0..16).map(|i| stripes(i * 3, 90)).collect();
    let ffmpeg = shop.ffmpeg(&pictures, SECONDS, "");
    let answer = fs::read_to_string(shop.path("ffprobe")).unwrap();
    let (_, rest) = answer.split_once('\n').unwrap();
    // Of pixels that are twice as wide as they are high, in rows of two moments.
    let rest = rest.replace(
        "\"width\": 64",
        "\"sample_aspect_ratio\": \"2:1\", \"field_order\": \"tt\", \"width\": 32",
    );
    shop.script("ffprobe", &rest);
    let frames = shop.path("frames");
    fs::create_dir(&frames).unwrap();
    let options = FrameOptions::default();
    let taken = ffmpeg.take_frames(&video, &frames, &options, &()).unwrap();
    for says in ["8 frames of 64x48 are taken", "the video is interlaced"] {
        assert!(
            taken.notes.iter().any(|note| note.starts_with(says)),
            "{:?}",
            taken.notes
        );
    }
    assert!(shop.told()[0].contains(" -vf yadif=deint=interlaced,fps="));
}

#[test]
fn files_that_are_no_videos_are_refused() {
    let shop = Workshop::new();
    let ffmpeg = shop.ffmpeg(&[], SECONDS, "");
    let said = |path: &Path| ffmpeg.probe(path).unwrap_err().to_string();
    assert!(said(&shop.path("absent.mp4")).contains("there is no such file"));
    let video = shop.path("v.mp4");
    fs::write(&video, "no video").unwrap();
    assert_eq!(ffmpeg.probe(&video).unwrap().size, (64, 48));
    let complaint = "echo 'v.mp4: Invalid data found when processing input' >&2; exit 1";
    shop.script("ffprobe", complaint);
    assert!(said(&video).contains("ffprobe cannot read it (v.mp4: Invalid data found"));
    shop.script("ffprobe", "echo '{\"streams\": []}'");
    assert!(said(&video).contains("there is no video in the file; convert it first"));
}

#[test]
fn a_video_of_which_something_is_said_is_read_all_the_same() {
    let shop = Workshop::new();
    let ffmpeg = shop.ffmpeg(&[], SECONDS, "");
    let video = shop.path("v.mp4");
    fs::write(&video, "a video").unwrap();
    let answer = fs::read_to_string(shop.path("ffprobe")).unwrap();
    let (_, rest) = answer.split_once('\n').unwrap();
    let complaint = "echo 'v.mp4: decoding for stream 0 failed' >&2";
    shop.script("ffprobe", &format!("{complaint}\n{rest}\n{complaint}"));
    assert_eq!(ffmpeg.probe(&video).unwrap().size, (64, 48));
}
