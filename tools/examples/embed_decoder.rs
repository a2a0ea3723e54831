//! Decodes a view while its file is still arriving, within a limit on memory: `embed_decoder < FILE`. Needs no feature of the crate.

use std::error::Error;
use std::io::Read;
use tsuya::container::Poll;
use tsuya::decoder::{IncrementalDecoder, ViewStatus};
use tsuya::{Limits, Photograph};

/// What a file may ask for here.
const LIMITS: Limits = Limits { memory_bytes: 64 << 20, views: 1000, image_side: 4096, mesh_elements: 1 << 20 };

/// Reads a stream in pieces until this view is decoded; with it the number of bytes that this took.
pub fn run(mut stream: impl Read, piece: usize, view: usize) -> Result<(Photograph, u64), Box<dyn Error>> {
    // Neither length nor any range of the file can be had before its time.
    let mut decoder = IncrementalDecoder::new(None, false, LIMITS);
    let mut buffer = vec![0; piece];
    let mut received = 0;
    loop {
        match decoder.view(view)? {
            Poll::Ready(ViewStatus::Decoded(photograph)) => return Ok((photograph, received)),
            Poll::Ready(ViewStatus::InProgress) => continue,
            Poll::Ready(ViewStatus::Absent) => return Err("the file holds no photographs".into()),
            Poll::NeedRanges(_) => {}
        }
        match stream.read(&mut buffer)? {
            0 => return Err(format!("the stream ends after {received} bytes").into()),
            count => {
                decoder.feed(received, &buffer[..count])?;
                received += count as u64;
            }
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let (photograph, received) = run(std::io::stdin().lock(), 1024, 0)?;
    let mask = &photograph.mask;
    println!("{} x {} pixels, {} of the object, after {received} bytes", mask.width, mask.height, mask.count());
    Ok(())
}
