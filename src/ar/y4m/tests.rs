//! Streams, their samples and their faults.

use super::*;
use crate::image::Grid;
use crate::input::FileAccess;

fn parse(line: &str) -> Result<Y4mHeader> {
    Y4mHeader::parse(line, Path::new("-"))
}

fn reader(bytes: &[u8]) -> Result<Y4mReader<&[u8]>> {
    Y4mReader::new(bytes, Path::new("-"), &FileAccess::default())
}

/// A stream of one frame with a gradient, and that frame.
fn stream(chroma: &str, [width, height]: [usize; 2]) -> (Vec<u8>, usize) {
    let mut bytes = format!("YUV4MPEG2 W{width} H{height} F30000:1001 Ip A1:1 C{chroma} XYSCSS=ANY\n").into_bytes();
    let header = parse(std::str::from_utf8(&bytes).unwrap().trim_end()).unwrap();
    bytes.extend(b"FRAME Ip\n");
    bytes.extend((0..header.frame_bytes()).map(|k| (40 + k * 7 % 170) as u8));
    (bytes, header.frame_bytes())
}

#[test]
fn streams_come_back_and_only_changes_are_written() {
    for (chroma, bytes) in
        [("420jpeg", 35 + 24), ("420mpeg2", 59), ("420paldv", 59), ("422", 35 + 40), ("444", 105), ("mono", 35)]
    {
        let (stream, length) = stream(chroma, [7, 5]);
        assert_eq!(length, bytes, "{chroma}");
        let mut reader = reader(&stream).unwrap();
        let header = reader.header().clone();
        assert_eq!((header.size(), header.rate()), ([7, 5], Some([30000, 1001])));
        let mut frame = Y4mFrame::default();
        assert!(reader.read_frame(&mut frame).unwrap());
        let before = frame.to_image(&header).unwrap();
        let mut writer = Y4mWriter::new(Vec::new(), Path::new("-"), &header).unwrap();
        let mut same = frame.clone();
        same.update(&header, &before, &before).unwrap();
        writer.write_frame(&same).unwrap();
        assert_eq!(writer.finish().unwrap(), stream, "{chroma}");
        // One pixel: its luma, and the sample of each colour that it shares.
        let mut after = before.clone();
        *after.value_at_mut(6, 4) = [200, 60, 90];
        let mut changed = frame.clone();
        changed.update(&header, &before, &after).unwrap();
        let count = changed.planes.iter().zip(&frame.planes).filter(|(a, b)| a != b).count();
        let expected = if chroma == "mono" { 1 } else { 3 };
        assert_eq!(count, expected, "{chroma}");
        assert!(!reader.read_frame(&mut frame).unwrap());
    }
}

#[test]
fn colours_are_those_of_bt601() {
    for (header, tolerance) in [
        (Y4mHeader::new([4, 1], [25, 1]).unwrap(), 2),
        (parse("YUV4MPEG2 W4 H1 F25:1 C444 XCOLORRANGE=FULL").unwrap(), 1),
    ] {
        let image = Grid { width: 4, height: 1, data: vec![[255, 255, 255], [255, 0, 0], [10, 200, 30], [0, 0, 0]] };
        let frame = Y4mFrame::from_image(&header, &image).unwrap();
        let back = frame.to_image(&header).unwrap();
        assert!(Y4mFrame::default().to_image(&header).is_err());
        for (a, b) in back.data.iter().zip(&image.data) {
            assert!((0..3).all(|c| a[c].abs_diff(b[c]) <= tolerance), "{a:?} {b:?}");
        }
        let white = if header.is_full_range { [255, 128, 128] } else { [235, 128, 128] };
        assert_eq!([0, 4, 8].map(|at| frame.planes[at]), white);
    }
    // Red of BT.601 within 16 to 235: Y 81, Cb 90, Cr 240.
    let red = Grid { width: 1, height: 1, data: vec![[255, 0, 0]] };
    let frame = Y4mFrame::from_image(&Y4mHeader::new([1, 1], [25, 1]).unwrap(), &red).unwrap();
    assert_eq!(frame.planes, [81, 90, 240]);
}

#[test]
fn what_is_wrong_is_named() {
    let fault = |line: &str| parse(line).unwrap_err().to_string();
    for (line, said) in [
        ("RIFF", "no YUV4MPEG2 stream"),
        ("YUV4MPEG2 W4 H4 F25:1 C420p10", "not supported: -: samples of colour \"420p10\""),
        ("YUV4MPEG2 W4 H4 F25:1 C444alpha", "444alpha"),
        ("YUV4MPEG2 W4 H4 F25:1 C411", "411"),
        ("YUV4MPEG2 W4 F25:1", "no height"),
        ("YUV4MPEG2 W0 H4 F25:1", "0 x 4"),
        ("YUV4MPEG2 W4 H99999 F25:1", "4 x 99999"),
        ("YUV4MPEG2 W16384 H16384", "16384 x 16384"),
        ("YUV4MPEG2 W4 W4 H4", "a second \"W4\""),
        ("YUV4MPEG2 W-4 H4", "no number of pixels"),
        ("YUV4MPEG2 W4 H4 F25", "no rate"),
        ("YUV4MPEG2 W4 H4 Q7", "unknown parameter \"Q7\""),
    ] {
        assert!(fault(line).contains(said), "{line}: {}", fault(line));
    }
    assert_eq!(parse("YUV4MPEG2 W4 H4 F0:0").unwrap().rate(), None);
    let (whole, _) = stream("420jpeg", [7, 5]);
    let ends = |length: usize| {
        let mut reader = reader(&whole[..length])?;
        let mut frame = Y4mFrame::default();
        while reader.read_frame(&mut frame)? {}
        Ok::<_, Error>(())
    };
    let header = whole.iter().position(|&b| b == b'\n').unwrap() + 1;
    for length in (0..whole.len()).filter(|&length| length != header) {
        let said = ends(length).unwrap_err().to_string();
        assert!(said.starts_with("-: "), "{length}: {said}");
    }
    assert!(ends(header).is_ok() && ends(whole.len()).is_ok());
    assert!(
        ends(whole.len() - 1).unwrap_err().to_string().contains("frame 0: the stream ends after 58 of its 59 bytes")
    );
    let odd = [&whole[..], b"FRAMES\n"].concat();
    let mut reader = reader(&odd).unwrap();
    assert!(reader.read_frame(&mut Y4mFrame::default()).unwrap());
    let said = reader.read_frame(&mut Y4mFrame::default()).unwrap_err().to_string();
    assert!(said.contains("frame 1 begins with \"FRAMES\""), "{said}");
    // What is read is written, and read again: lines do not grow beyond what is taken.
    let no_text = [&whole[..header], b"FRAME I\xf1\xf1\n", &whole[header + 6..]].concat();
    let mut frames = self::reader(&no_text).unwrap();
    let said = frames.read_frame(&mut Y4mFrame::default()).unwrap_err().to_string();
    assert!(said.contains("frame 0: its line is no text"), "{said}");
    let long = |length: usize| format!("YUV4MPEG2 W4 H4 X{}\n", "a".repeat(length));
    let said = self::reader(long(1000).as_bytes()).err().unwrap().to_string();
    assert!(said.contains("its header's parameters are too long"), "{said}");
    assert!(self::reader(long(900).as_bytes()).is_ok());
    let limits = crate::limits::Limits { memory_bytes: 1000, ..Default::default() };
    let small = Y4mReader::new(&b"YUV4MPEG2 W1000 H1000\n"[..], Path::new("-"), &FileAccess::new(limits));
    assert!(small.err().unwrap().to_string().contains("memory_bytes"));
    assert!(reader_of_nothing().contains("no YUV4MPEG2 stream"));
}

fn reader_of_nothing() -> String {
    reader(b"").err().unwrap().to_string()
}
