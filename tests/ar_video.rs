//! Videos through standard input and output, frame by frame, and several objects in one run.

use crate::markers::{ARUCO_0, TAG36H11_0, camera, draw, posed};
use crate::stage::stage;
use crate::support::{complaint, json, text};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};
use tsuya::capture::Lens;

const SIZE: [usize; 2] = [640, 480];
const LINE: &str = "YUV4MPEG2 W640 H480 F30000:1001 Ip A1:1 C420jpeg XYSCSS=420JPEG\n";

/// Planes of a frame of 4:2:0 that shows a grey image, its colours a gradient.
fn planes(path: &Path) -> Vec<u8> {
    let grey = image::open(path).unwrap().into_luma8();
    let luma = grey.pixels().map(|p| (16.0 + p.0[0] as f64 * 219.0 / 255.0).round() as u8);
    let colours = (0..2 * 320 * 240).map(|k| (126 + k % 5) as u8);
    luma.chain(colours).collect()
}

/// Arguments of `tsuya ar` on a folder of [`stage`].
fn arguments(folder: &Path, frames: &str, output: &str, more: &[&str]) -> Vec<String> {
    let at = |name: &str| if name == "-" { name.to_owned() } else { text(&folder.join(name)).to_owned() };
    let mut arguments = vec!["ar".to_owned(), at(frames)];
    for (flag, value) in
        [("--asset", at("asset.tsuya")), ("--marker", "tag36h11:0:0.1".into()), ("--camera", at("camera.json"))]
    {
        arguments.extend([flag.to_owned(), value]);
    }
    arguments.extend(["--env".to_owned(), at("sky.png"), "-o".into(), at(output)]);
    arguments.extend(more.iter().map(|s| s.to_string()));
    arguments
}

fn start(arguments: &[String]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tsuya"));
    command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Exit code, standard output and error of a run with these bytes on standard input.
fn run(arguments: &[String], input: &[u8]) -> (i32, Vec<u8>, String) {
    let mut child = start(arguments);
    let mut stdin = child.stdin.take().unwrap();
    let input = input.to_vec();
    // It may end before it has read all.
    let writer = std::thread::spawn(move || drop(stdin.write_all(&input)));
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap();
    (output.status.code().unwrap(), output.stdout, String::from_utf8(output.stderr).unwrap())
}

#[test]
fn a_camera_is_piped_through_frame_by_frame() {
    let folder = stage();
    let at = |name: &str| folder.path().join(name);
    image::GrayImage::from_pixel(640, 480, image::Luma([90])).save(at("empty.png")).unwrap();
    let shown: Vec<Vec<u8>> = (0..12)
        .map(|k| planes(&at(&if k == 5 { "empty.png".into() } else { format!("frames/{}.png", k % 4) })))
        .collect();
    let mut child = start(&arguments(folder.path(), "-", "-", &[]));
    let mut stdin = child.stdin.take().unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        let mut line = String::new();
        stdout.read_line(&mut line).unwrap();
        sender.send(line.into_bytes()).unwrap();
        loop {
            let (mut line, mut frame) = (String::new(), vec![0; 640 * 480 * 3 / 2]);
            if stdout.read_line(&mut line).unwrap() == 0 {
                return;
            }
            assert_eq!(line, "FRAME\n");
            stdout.read_exact(&mut frame).unwrap();
            sender.send(frame).unwrap();
        }
    });
    // No frame is sent before the last one has come back.
    let wait = || receiver.recv_timeout(Duration::from_secs(100)).expect("the frame waits for another one");
    stdin.write_all(LINE.as_bytes()).unwrap();
    let mut latencies = Vec::new();
    for (number, frame) in shown.iter().enumerate() {
        let clock = Instant::now();
        stdin.write_all(b"FRAME\n").unwrap();
        stdin.write_all(frame).unwrap();
        stdin.flush().unwrap();
        if number == 0 {
            assert_eq!(wait(), LINE.as_bytes());
        }
        let placed = wait();
        latencies.push(clock.elapsed().as_secs_f64());
        let changed = placed.iter().zip(frame).filter(|(a, b)| a != b).count();
        // Samples of what is not touched stay as they were.
        assert!(
            placed[..640 * 100] == frame[..640 * 100] && placed[640 * 470..640 * 480] == frame[640 * 470..640 * 480]
        );
        assert!(if number == 5 { changed == 0 } else { (1500..150_000).contains(&changed) }, "{number}: {changed}");
    }
    drop(stdin);
    assert!(receiver.recv_timeout(Duration::from_secs(20)).is_err());
    let ended = child.wait_with_output().unwrap();
    let said = String::from_utf8(ended.stderr).unwrap();
    assert!(ended.status.success() && said.contains("1 of 12 frames show no marker"), "{said}");
    let mut later = latencies[2..].to_vec();
    later.sort_by(f64::total_cmp);
    println!(
        "first frame {:.0} ms, later ones {:.1} ms (median), {:.1} at most",
        1e3 * latencies[0],
        1e3 * later[5],
        1e3 * later[9]
    );
    println!("{said}");
}

#[test]
fn streams_that_end_early_say_so() {
    let folder = stage();
    let frame = [b"FRAME\n".to_vec(), planes(&folder.path().join("frames/0.png"))].concat();
    let whole = [LINE.as_bytes(), &frame, &frame].concat();
    let with = |line: &str| [line.as_bytes(), &frame].concat();
    let stream = arguments(folder.path(), "-", "-", &[]);
    for (input, code, said) in [
        (whole[..whole.len() - 1].to_vec(), 3, "frame 1: the stream ends after 460799 of its 460800 bytes"),
        (Vec::new(), 3, "no YUV4MPEG2 stream"),
        (b"\x89PNG\r\n\x1a\n".to_vec(), 3, "no YUV4MPEG2 stream"),
        (with(&LINE.replace("420jpeg", "420p10")), 5, "\"420p10\""),
        (with(&LINE.replace("W640", "W99999")), 3, "99999 x 480"),
        (with(&LINE.replace("W640", "W320")), 3, "320 x 480 pixels, but"),
        (LINE.as_bytes().to_vec(), 4, "any of the 0 frames"),
    ] {
        let (ended, _, error) = run(&stream, &input);
        assert!(ended == code && error.contains(said), "{ended} {said}: {error}");
    }
    // What was whole before the fault is there.
    let (_, written, _) = run(&stream, &whole[..whole.len() - 1]);
    assert_eq!(written.len(), LINE.len() + frame.len());
    // Nobody reads any longer: a quiet end.
    let mut child = start(&stream);
    let mut stdin = child.stdin.take().unwrap();
    drop(child.stdout.take());
    let many = [LINE.as_bytes(), &frame.repeat(4)].concat();
    std::thread::spawn(move || drop(stdin.write_all(&many)));
    let ended = child.wait_with_output().unwrap();
    assert!(ended.status.success() && ended.stderr.is_empty(), "{ended:?}");
    // Files of this kind take no ffmpeg, and other frames become such a stream.
    // The object stands beside the marker, which is found once more in what was made.
    let none = ["--ffmpeg", "/nowhere/ffmpeg", "--json", "--translate", "0.15,0,0", "--size", "0.05"];
    let (code, _, error) = run(&arguments(folder.path(), "frames", "clip.y4m", &none), b"");
    assert_eq!(code, 0, "{error}");
    let clip = std::fs::read(folder.path().join("clip.y4m")).unwrap();
    assert!(clip.starts_with(b"YUV4MPEG2 W640 H480 F30:1 Ip A1:1 C444 XCOLORRANGE=LIMITED\nFRAME\n"));
    let length = clip.iter().position(|&b| b == b'\n').unwrap() + 1 + 4 * (6 + 3 * SIZE[0] * SIZE[1]);
    assert_eq!(clip.len(), length);
    let (code, _, error) = run(&arguments(folder.path(), "clip.y4m", "again", &none), b"");
    assert_eq!(code, 0, "{error}");
    assert!(folder.path().join("again/000003.png").exists());
}

#[test]
fn several_objects_shadow_each_other() {
    let folder = stage();
    let at = |name: &str| folder.path().join(name);
    let asset = text(&at("asset.tsuya")).to_owned();
    let place = |output: &str, more: &[&str]| {
        let (code, _, error) = run(&arguments(folder.path(), "frames/1.png", output, more), b"");
        assert_eq!(code, 0, "{error}");
        image::open(at(output)).unwrap().into_rgb8()
    };
    let plain = ["--size", "0.06", "--noise", "0", "--samples", "1"];
    let before = image::open(at("frames/1.png")).unwrap().into_rgb8();
    let right = place("right.png", &[&plain[..], &["--translate", "0.04,0,0"]].concat());
    let both = [
        &plain[..],
        &[
            "--asset",
            &asset,
            "--translate",
            "0.04,0,0",
            "--translate",
            "-0.03,0,0",
            "--rotate-y",
            "0",
            "--rotate-y",
            "180",
        ],
    ]
    .concat();
    let two = place("two.png", &both);
    let one_thread = place("one-thread.png", &[&both[..], &["--threads", "1"]].concat());
    assert!(two == one_thread);
    let changed = |image: &image::RgbImage| {
        image.pixels().zip(before.pixels()).filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > 20)).count()
    };
    let (one, both) = (changed(&right), changed(&two));
    // The right object's far side shows the same, a little darker for the other one's shadow.
    let mean = |image: &image::RgbImage| {
        let part = image::imageops::crop_imm(image, 360, 200, 30, 60).to_image();
        part.pixels().map(|p| p.0.iter().map(|&c| c as f64).sum::<f64>()).sum::<f64>() / (3.0 * 30.0 * 60.0)
    };
    println!(
        "one object changes {one} pixels, two {both}; the right one's mean is {:.2} and {:.2}",
        mean(&right),
        mean(&two)
    );
    assert!((1.4..2.6).contains(&(both as f64 / one as f64)), "{one} {both}");
    assert!(mean(&two) < mean(&right) - 0.2 && mean(&two) > mean(&right) - 40.0);
}

#[test]
fn objects_on_markers_of_their_own_hide_each_other() {
    let folder = stage();
    let at = |name: &str| folder.path().join(name);
    // Two markers on one table, which the camera sees at once.
    let pose = |x: f64| posed([-50.0, 0.0, 0.0], [x, 0.02, 0.6]);
    let drawn = [(&TAG36H11_0[..], -0.09), (&ARUCO_0[..], 0.09)]
        .map(|(cells, x)| draw(&camera(640, 480, 600.0), &Lens::Pinhole, cells, &pose(x), 3));
    let mut frame = image::GrayImage::new(640, 480);
    for (x, y, pixel) in frame.enumerate_pixels_mut() {
        pixel.0 = [*drawn[usize::from(x >= 320)].value_at(x as usize, y as usize)];
    }
    frame.save(at("table.png")).unwrap();
    let asset = text(&at("asset.tsuya")).to_owned();
    // The first object stands beside its marker and behind the second one, which it is drawn before, whatever comes first on the command line.
    let run = |order: [usize; 2], output: &str| {
        let (markers, places, sizes) =
            (["tag36h11:0:0.1", "aruco:0:0.1"], ["0.16,0,-0.02", "0,0,0.02"], ["0.08", "0.05"]);
        let path = |name: &str| text(&at(name)).to_owned();
        let mut arguments = vec!["ar".to_owned(), path("table.png")];
        for k in order {
            let values = ["--asset", &asset, "--marker", markers[k], "--translate", places[k], "--size", sizes[k]];
            arguments.extend(values.map(String::from));
        }
        for (flag, name) in [("--camera", "camera.json"), ("--env", "sky.png"), ("-o", output)] {
            arguments.extend([flag.to_owned(), path(name)]);
        }
        arguments.extend(["--samples", "1", "--noise", "0", "--json"].map(String::from));
        let report = json(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
        (report, image::open(at(output)).unwrap().into_rgb8())
    };
    let (report, placed) = run([0, 1], "placed.png");
    let (_, swapped) = run([1, 0], "swapped.png");
    let poses = report["poses"].as_array().unwrap();
    let found: Vec<(&str, f64)> = (poses.iter())
        .map(|pose| (pose["marker"].as_str().unwrap(), pose["translation"][0].as_f64().unwrap()))
        .collect();
    assert!(found[0].0 == "tag36h11:0" && (found[0].1 + 0.09).abs() < 0.003, "{found:?}");
    assert!(found[1].0 == "aruco:0" && (found[1].1 - 0.09).abs() < 0.003, "{found:?}");
    let differ = |a: &image::RgbImage, b: &image::RgbImage| {
        a.pixels().zip(b.pixels()).filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > 3)).count()
    };
    let before = image::open(at("table.png")).unwrap().into_rgb8();
    println!("{} pixels changed, {} by the order", differ(&placed, &before), differ(&placed, &swapped));
    assert!(differ(&placed, &swapped) == 0 && differ(&placed, &before) > 2000);
    let wrong =
        ["ar", "x.png", "--asset", "a", "--asset", "b", "--asset", "c", "--marker", "d", "--marker", "e", "--camera"];
    let camera = at("camera.json");
    let said = complaint(1, &[&wrong[..], &[text(&camera), "--env", "e", "-o", "f.png"]].concat());
    assert!(said.contains("--marker comes 2 times for 3 objects"), "{said}");
}
