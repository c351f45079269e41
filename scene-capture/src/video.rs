//! Videos: what ffprobe says about them, and which moments to look at.

use crate::error::CaptureError;
use crate::program::Program;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::Path;

/// How to get it.
const GET: &str = "install ffmpeg, which brings ffprobe: apt install ffmpeg (Debian, Ubuntu), \
    brew install ffmpeg (macOS), winget install ffmpeg (Windows), or conda install -c conda-forge \
    ffmpeg";

/// Pictures looked at to take one of them. Hands shake at up to 10 Hz: among five pictures of a
/// moment one is usually at a turning point.
const CANDIDATES: usize = 5;
/// Where a file does not say how many pictures a second it has.
const USUAL_RATE: f64 = 25.0;
/// Transfer characteristics of pictures with more contrast than sRGB has.
const HDR: [&str; 2] = ["arib-std-b67", "smpte2084"];
/// Orders of the fields of interlaced pictures; others are `progressive` and `unknown`.
const INTERLACED: [&str; 4] = ["tt", "bb", "tb", "bt"];

/// How many frames to take from a video.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameOptions {
    /// About as many in all.
    pub count: usize,
    /// No more in a second, where the video is short.
    pub per_second: f64,
}

impl Default for FrameOptions {
    /// 120, at most 4 a second: a walk around a thing in half a minute to two minutes, seen every
    /// few degrees.
    fn default() -> Self {
        Self {
            count: 120,
            per_second: 4.0,
        }
    }
}

/// ffmpeg and ffprobe on this machine.
#[derive(Debug, Clone)]
pub struct Ffmpeg {
    pub(crate) ffmpeg: Program,
    ffprobe: Program,
}

/// What a video file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct VideoInfo {
    /// Width and height of the pictures, turned as they are shown.
    pub size: (u32, u32),
    /// Length in seconds.
    pub seconds: f64,
    /// Pictures per second.
    pub rate: f64,
    /// By how many degrees a player turns the pictures.
    pub rotation: i32,
    /// Width of a pixel by its height.
    pub pixel_aspect: f64,
    /// Whether the pictures have more contrast than photos.
    pub is_hdr: bool,
    /// Whether every picture is made of two, taken one after the other, in every other row.
    pub is_interlaced: bool,
}

/// Equal windows of time, and how many pictures are looked at in each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Windows {
    pub(crate) count: usize,
    pub(crate) candidates: usize,
    /// Candidates per second of video.
    pub(crate) rate: f64,
}

impl Windows {
    pub(crate) fn over(info: &VideoInfo, options: &FrameOptions) -> Windows {
        let pictures = (info.seconds * info.rate).max(1.0);
        let most = (info.seconds * options.per_second).min(pictures).max(1.0);
        let count = options.count.clamp(1, most as usize);
        let candidates = ((pictures / count as f64) as usize).clamp(1, CANDIDATES);
        let rate = ((count * candidates) as f64 / info.seconds).min(info.rate);
        Windows {
            count,
            candidates,
            rate,
        }
    }

    /// The window of the candidate of that number. There may be a few more than planned: they
    /// belong to the last.
    pub(crate) fn of(&self, candidate: usize) -> usize {
        (candidate / self.candidates).min(self.count - 1)
    }
}

impl Ffmpeg {
    /// The programs on the PATH.
    ///
    /// # Errors
    /// [`CaptureError::Missing`] with how to install them.
    pub fn find() -> Result<Self, CaptureError> {
        Ok(Self {
            ffmpeg: Program::find("ffmpeg", GET)?,
            ffprobe: Program::find("ffprobe", GET)?,
        })
    }

    /// The programs at two paths.
    #[must_use]
    pub fn at(ffmpeg: &Path, ffprobe: &Path) -> Self {
        Self {
            ffmpeg: Program::at(ffmpeg),
            ffprobe: Program::at(ffprobe),
        }
    }

    /// What a video file holds.
    ///
    /// # Errors
    /// [`CaptureError::Content`] if it is no video, or does not say how long it is.
    pub fn probe(&self, video: &Path) -> Result<VideoInfo, CaptureError> {
        if !video.is_file() {
            return Err(CaptureError::bad(
                video,
                "there is no such file",
                "give a video file",
            ));
        }
        let mut arguments: Vec<OsString> = ["-v", "error", "-select_streams", "V:0"]
            .map(OsString::from)
            .into();
        arguments.extend(["-show_streams", "-show_format", "-of", "json"].map(OsString::from));
        arguments.push(file_url(video));
        // What it complains of on the way is none of the answer.
        let (status, text, complaints) = self.ffprobe.answer(&arguments)?;
        if !status.success() {
            let mut other = crate::program::LastLines::default();
            complaints.into_iter().for_each(|line| other.push(line));
            let why = other.reason().unwrap_or_default();
            return Err(CaptureError::bad(
                video,
                format!("ffprobe cannot read it ({why})"),
                "copy it again, or convert it to MP4",
            ));
        }
        info_in(&text).map_err(|what| {
            CaptureError::bad(
                video,
                what,
                "convert it first: ffmpeg -i VIDEO -c copy NEW.mp4",
            )
        })
    }
}

/// A path that ffmpeg cannot take for an option or another protocol.
pub(crate) fn file_url(path: &Path) -> OsString {
    let mut url = OsString::from("file:");
    url.push(path);
    url
}

#[derive(Debug, Deserialize)]
struct Probed {
    #[serde(default)]
    streams: Vec<Stream>,
    #[serde(default)]
    format: Container,
}

#[derive(Debug, Default, Deserialize)]
struct Container {
    duration: Option<String>,
}

#[derive(Debug, Deserialize)]
struct Stream {
    width: Option<u32>,
    height: Option<u32>,
    avg_frame_rate: Option<String>,
    r_frame_rate: Option<String>,
    sample_aspect_ratio: Option<String>,
    color_transfer: Option<String>,
    field_order: Option<String>,
    duration: Option<String>,
    #[serde(default)]
    tags: BTreeMap<String, String>,
    #[serde(default)]
    side_data_list: Vec<SideData>,
}

#[derive(Debug, Deserialize)]
struct SideData {
    rotation: Option<f64>,
}

/// Reads ffprobe's JSON; what is wrong otherwise. Its complaints may stand around it.
fn info_in(text: &str) -> Result<VideoInfo, String> {
    let json = match (text.find('{'), text.rfind('}')) {
        (Some(from), Some(to)) if from < to => &text[from..=to],
        _ => text,
    };
    let probed: Probed =
        serde_json::from_str(json).map_err(|e| format!("ffprobe's answer makes no sense ({e})"))?;
    let Some(stream) = probed.streams.first() else {
        return Err("there is no video in the file".to_owned());
    };
    let (Some(width), Some(height)) = (stream.width, stream.height) else {
        return Err("the video has no pictures".to_owned());
    };
    let positive = |value: &f64| value.is_finite() && *value > 0.0;
    let number = |text: &Option<String>| text.as_ref()?.parse::<f64>().ok().filter(positive);
    let seconds = number(&stream.duration)
        .or_else(|| number(&probed.format.duration))
        .or_else(|| clock(stream.tags.get("DURATION")?).filter(positive))
        .ok_or("the file does not say how long the video is")?;
    let rate = [&stream.avg_frame_rate, &stream.r_frame_rate]
        .into_iter()
        .find_map(|text| ratio(text.as_deref()?, '/').filter(positive))
        .unwrap_or(USUAL_RATE);
    let rotation = stream
        .side_data_list
        .iter()
        .find_map(|data| data.rotation)
        // As players turn: what ffprobe states is the other way round.
        .map(|degrees| -degrees)
        .or_else(|| stream.tags.get("rotate")?.parse().ok())
        .map_or(0, |degrees| (degrees.round() as i32).rem_euclid(360));
    let sideways = rotation % 180 == 90;
    Ok(VideoInfo {
        size: if sideways {
            (height, width)
        } else {
            (width, height)
        },
        seconds,
        rate,
        rotation,
        pixel_aspect: stream
            .sample_aspect_ratio
            .as_deref()
            .and_then(|text| ratio(text, ':'))
            .filter(positive)
            .unwrap_or(1.0),
        is_hdr: stream
            .color_transfer
            .as_deref()
            .is_some_and(|transfer| HDR.contains(&transfer)),
        is_interlaced: stream
            .field_order
            .as_deref()
            .is_some_and(|order| INTERLACED.contains(&order)),
    })
}

/// `30000/1001`.
fn ratio(text: &str, between: char) -> Option<f64> {
    let (above, below) = text.split_once(between)?;
    Some(above.parse::<f64>().ok()? / below.parse::<f64>().ok()?)
}

/// `00:01:02.500000000`.
fn clock(text: &str) -> Option<f64> {
    let mut seconds = 0.0;
    for part in text.split(':') {
        seconds = 60.0 * seconds + part.trim().parse::<f64>().ok()?;
    }
    Some(seconds)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn info(seconds: f64, rate: f64) -> VideoInfo {
        VideoInfo {
            size: (64, 48),
            seconds,
            rate,
            rotation: 0,
            pixel_aspect: 1.0,
            is_hdr: false,
            is_interlaced: false,
        }
    }

    #[test]
    fn windows_share_the_video_evenly() {
        let over = |seconds, rate, count| {
            let options = FrameOptions {
                count,
                ..FrameOptions::default()
            };
            let windows = Windows::over(&info(seconds, rate), &options);
            (windows.count, windows.candidates, windows.rate)
        };
        // Long enough: as many as asked for, five looks each.
        assert_eq!(over(60.0, 30.0, 120), (120, 5, 10.0));
        // Short: four a second.
        assert_eq!(over(10.0, 30.0, 120), (40, 5, 20.0));
        // No more looks than pictures.
        assert_eq!(over(10.0, 10.0, 120), (40, 2, 8.0));
        assert_eq!(over(100.0, 1.0, 120), (100, 1, 1.0));
        // Very short, or nothing asked for.
        assert_eq!(over(0.1, 30.0, 120).0, 1);
        assert_eq!(over(60.0, 30.0, 0).0, 1);
    }

    #[test]
    fn every_candidate_has_its_window() {
        let windows = Windows {
            count: 3,
            candidates: 2,
            rate: 1.0,
        };
        let of: Vec<usize> = (0..8).map(|i| windows.of(i)).collect();
        assert_eq!(of, [0, 0, 1, 1, 2, 2, 2, 2]);
    }

    #[test]
    fn answers_of_ffprobe_are_read() {
        let phone = r#"{"streams": [{"width": 1920, "height": 1080, "avg_frame_rate": "30000/1001",
            "r_frame_rate": "30/1", "duration": "12.5", "color_transfer": "arib-std-b67",
            "sample_aspect_ratio": "1:1", "tags": {"rotate": "90"},
            "side_data_list": [{"side_data_type": "Display Matrix", "rotation": -90}]}],
            "format": {"duration": "12.6"}}"#;
        let read = info_in(phone).unwrap();
        assert_eq!((read.size, read.rotation), ((1080, 1920), 90));
        assert!((read.rate - 29.97).abs() < 0.001);
        assert_eq!((read.seconds, read.pixel_aspect), (12.5, 1.0));
        assert!(read.is_hdr && !read.is_interlaced);
        let mkv = r#"[warning] odd
            {"streams": [{"width": 720, "height": 576, "avg_frame_rate": "0/0",
            "r_frame_rate": "25/1", "sample_aspect_ratio": "64:45", "field_order": "tb",
            "tags": {"DURATION": "00:01:02.500000000"}}], "format": {}}"#;
        let read = info_in(mkv).unwrap();
        assert_eq!((read.seconds, read.rate, read.rotation), (62.5, 25.0, 0));
        assert!((read.pixel_aspect - 1.4222).abs() < 0.001 && read.is_interlaced);
    }

    #[test]
    fn answers_that_say_nothing_are_errors() {
        for (text, what) in [
            ("", "makes no sense"),
            ("{}", "no video"),
            (r#"{"streams": []}"#, "no video"),
            (r#"{"streams": [{"width": 7}]}"#, "no pictures"),
            (
                r#"{"streams": [{"width": 7, "height": 7, "duration": "N/A"}]}"#,
                "how long",
            ),
            (
                r#"{"streams": [{"width": 7, "height": 7, "duration": "-1"}]}"#,
                "how long",
            ),
            (
                r#"{"streams": [{"width": 7, "height": 7, "duration": "inf"}]}"#,
                "how long",
            ),
        ] {
            let said = info_in(text).unwrap_err();
            assert!(said.contains(what), "{text}: {said}");
        }
    }
}
