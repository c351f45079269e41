//! What goes wrong leaves one sentence and no files.

use crate::stand_ins::{Dialect, Listener, Workshop};
use scene_capture::{CaptureError, CaptureOptions, Colmap, Source, Tools, capture};
use std::fs;
use std::process::Command;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

const NAMES: [&str; 3] = ["a.jpg", "b.jpg", "c.jpg"];

/// Fails with a COLMAP that does this first; says how.
fn failed(before: &str) -> String {
    let shop = Workshop::new();
    let tools = Tools {
        colmap: shop.colmap(Dialect::Three, before),
        ffmpeg: None,
    };
    let source = Source::Photos(shop.photos(&NAMES));
    let out = shop.path("made/scene");
    let error = capture(&source, &out, &tools, &CaptureOptions::default(), &()).unwrap_err();
    assert!(!out.exists());
    assert_eq!(
        fs::read_dir(shop.path("made")).unwrap().count(),
        0,
        "nothing is left"
    );
    error
        .to_string()
        .replace(&shop.dir.path().display().to_string(), "")
}

#[test]
fn failures_say_what_the_program_said() {
    assert_eq!(
        failed("if [ $1 = mapper ]; then echo 'Check failed: a > b' >&2; kill -6 $$; fi"),
        "/colmap failed at finding poses (Check failed: a > b); run colmap mapper by hand to see more"
    );
    let said = failed("if [ $1 = feature_extractor ]; then echo out of memory; exit 3; fi");
    assert!(
        said.contains("failed at finding features (out of memory); if memory"),
        "{said}"
    );
    let said = failed("if [ $1 = exhaustive_matcher ]; then exit 3; fi");
    assert!(
        said.contains("comparing photos (exit status: 3 without a word)"),
        "{said}"
    );
}

#[test]
fn photos_without_poses_are_an_error_with_a_remedy() {
    let said = failed("");
    assert!(
        said.starts_with("/photos: COLMAP found no poses for its 3 photos; take more"),
        "{said}"
    );
}

#[test]
fn photos_that_colmap_refuses_are_named() {
    let shop = Workshop::new();
    shop.model(0, 0, &NAMES);
    let refuse = "if [ $1 = feature_extractor ]; then \
        printf '  Name:            b.jpg\\n  ERROR: Failed to read image file format.\\n'; fi";
    let tools = Tools {
        colmap: shop.colmap(Dialect::Three, refuse),
        ffmpeg: None,
    };
    let source = Source::Photos(shop.photos(&NAMES));
    let out = shop.path("scene");
    let captured = capture(&source, &out, &tools, &CaptureOptions::default(), &()).unwrap();
    let said = "COLMAP does without 1 photos, such as b.jpg: Failed to read image file format.";
    assert!(
        captured.notes.iter().any(|note| note == said),
        "{captured:?}"
    );
}

#[test]
fn whatever_runs_is_ended_when_asked_to_stop() {
    let shop = Workshop::new();
    let here = shop.dir.path().display();
    let wait = format!("if [ $1 = mapper ]; then echo $$ > '{here}/pid'; exec sleep 600; fi");
    let tools = Tools {
        colmap: shop.colmap(Dialect::Three, &wait),
        ffmpeg: None,
    };
    let source = Source::Photos(shop.photos(&NAMES));
    let watch = Listener::default();
    let (pid_file, out) = (shop.path("pid"), shop.path("scene"));
    let begun = Instant::now();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while fs::read_to_string(&pid_file).unwrap_or_default().is_empty() {
                std::thread::sleep(Duration::from_millis(20));
            }
            watch.stop.store(true, Ordering::SeqCst);
        });
        let error = capture(&source, &out, &tools, &CaptureOptions::default(), &watch).unwrap_err();
        assert!(matches!(error, CaptureError::Interrupted), "{error}");
    });
    assert!(begun.elapsed() < Duration::from_secs(60));
    let pid = fs::read_to_string(&pid_file).unwrap();
    let alive = Command::new("sh")
        .args(["-c", &format!("kill -0 {} 2>/dev/null", pid.trim())])
        .status()
        .unwrap();
    assert!(!alive.success(), "the mapper still runs");
    assert!(!shop.has_leftovers() && !out.exists());
}

#[test]
fn a_program_ended_by_ctrl_c_is_no_failure() {
    if interrupts_are_ignored() {
        eprintln!("skipped: this process was started with Ctrl-C ignored, and so are its children");
        return;
    }
    let shop = Workshop::new();
    let tools = Tools {
        colmap: shop.colmap(Dialect::Three, "kill -2 $$"),
        ffmpeg: None,
    };
    let source = Source::Photos(shop.photos(&NAMES));
    let error = capture(
        &source,
        &shop.path("scene"),
        &tools,
        &CaptureOptions::default(),
        &(),
    );
    assert!(matches!(error, Err(CaptureError::Interrupted)), "{error:?}");
}

/// Whether SIGINT is ignored, as in what a shell script runs in the background; a shell cannot undo that.
fn interrupts_are_ignored() -> bool {
    const SIGINT: u64 = 1 << 1;
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_some_and(|mask| mask & SIGINT != 0)
}

#[test]
fn what_is_not_colmap_is_recognised() {
    let shop = Workshop::new();
    let other = shop.script("other", "echo 'usage: other'");
    let said = Colmap::at(&other).unwrap_err().to_string();
    assert!(
        said.contains("other does not answer like COLMAP; install COLMAP: apt install"),
        "{said}"
    );
    // A Python whose module is older than what is asked of it, and one whose is not.
    let old = shop.script("python-3.9", "echo 'COLMAP 3.13.0 (pycolmap)'");
    let said = Colmap::by_python(&old).unwrap_err().to_string();
    assert!(
        said.contains("3.13.0") && said.contains("python-3.9"),
        "{said}"
    );
    assert!(said.contains("4.0 or newer"), "{said}");
    let new = shop.script("python-3.14", "echo 'COLMAP 4.2.1 (pycolmap)'");
    assert_eq!(Colmap::by_python(&new).unwrap().version(), "4.2.1");
    let said = Colmap::at(&shop.path("absent")).unwrap_err().to_string();
    assert!(said.starts_with("cannot start "), "{said}");
    // No commands but help.
    let bare = shop.script("bare", "echo 'COLMAP 2.0'");
    let tools = Tools {
        colmap: Colmap::at(&bare).unwrap(),
        ffmpeg: None,
    };
    assert_eq!(tools.colmap.version(), "2.0");
    let source = Source::Photos(shop.photos(&NAMES));
    let error = capture(
        &source,
        &shop.path("scene"),
        &tools,
        &CaptureOptions::default(),
        &(),
    );
    let said = error.unwrap_err().to_string();
    assert!(
        said.contains("(COLMAP 2.0) does not know the command feature_extractor"),
        "{said}"
    );
}

#[test]
fn masks_for_videos_and_places_in_the_way_are_refused_at_once() {
    let shop = Workshop::new();
    let tools = shop.tools(Dialect::Three);
    let video = shop.path("v.mp4");
    fs::write(&video, "").unwrap();
    let options = CaptureOptions {
        masks: Some(shop.path("masks")),
        ..CaptureOptions::default()
    };
    let out = shop.path("scene");
    let error = capture(&Source::Video(video.clone()), &out, &tools, &options, &());
    assert!(
        error
            .unwrap_err()
            .to_string()
            .contains("frames of a video have none yet")
    );
    let none = CaptureOptions::default();
    let error = capture(&Source::Video(video.clone()), &video, &tools, &none, &());
    assert!(
        error
            .unwrap_err()
            .to_string()
            .contains("v.mp4: it is in the way")
    );
    let photos = Source::Photos(shop.photos(&NAMES));
    let error = capture(&photos, &out, &tools, &options, &());
    assert!(
        error
            .unwrap_err()
            .to_string()
            .contains("masks: there is no such folder")
    );
    assert!(!out.exists() && shop.told().is_empty());
}
