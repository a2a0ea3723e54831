// Pictures of a camera.

/** Why a camera can't be used, in words. */
const REASONS = {
  NotAllowedError: "the page may not use the camera: allow it in the browser's settings for this address, then try again",
  NotFoundError: "there is no camera",
  NotReadableError: "the camera is used by another program",
  OverconstrainedError: "the camera that was chosen is not there any more",
  SecurityError: "cameras are not allowed here",
};

/** What went wrong with a camera. */
export class CameraError extends Error {
  constructor(cause) {
    super(REASONS[cause.name] ?? cause.message);
    this.name = "CameraError";
    this.cause = cause;
  }
}

/** Cameras that there are, as `{id, title}`; titles are known once a camera was allowed. */
export async function cameras() {
  const devices = (await navigator.mediaDevices?.enumerateDevices?.()) ?? [];
  return devices.filter(({ kind }) => kind === "videoinput").map(({ deviceId, label }, k) => ({ id: deviceId, title: label || `Camera ${k + 1}` }));
}

/** A running camera, whose pictures are read one by one. */
export class CameraPictures {
  /** Starts a camera: the one with this identity, or one that looks away from the user. Throws {@link CameraError}. */
  static async start(id = null, width = 640, height = 480) {
    if (!navigator.mediaDevices?.getUserMedia) {
      throw new CameraError(new Error("this browser gives no camera to pages that did not come by https or from this machine"));
    }
    const which = id ? { deviceId: { exact: id } } : { facingMode: "environment" };
    try {
      const stream = await navigator.mediaDevices.getUserMedia({ video: { ...which, width: { ideal: width }, height: { ideal: height } } });
      const video = document.createElement("video");
      Object.assign(video, { srcObject: stream, muted: true, playsInline: true });
      await video.play();
      return new CameraPictures(stream, video);
    } catch (error) {
      throw new CameraError(error);
    }
  }

  constructor(stream, video) {
    this.stream = stream;
    this.video = video;
    this.canvas = document.createElement("canvas");
    this.context = this.canvas.getContext("2d", { willReadFrequently: true });
    this.ended = false;
    stream.getVideoTracks()[0]?.addEventListener("ended", () => (this.ended = true));
  }

  /** Calls `each` for every new picture until {@link stop}. */
  run(each) {
    const { video } = this;
    let last = -1;
    const next = () => {
      if (this.stopped) return;
      if (video.currentTime !== last) {
        last = video.currentTime;
        each();
      }
      schedule();
    };
    const schedule = () => (video.requestVideoFrameCallback ? video.requestVideoFrameCallback(next) : requestAnimationFrame(next));
    schedule();
  }

  /** The picture of this moment, at most `most` pixels wide; it is on `canvas`, too. Null before the first. */
  read(most = 640) {
    const { videoWidth, videoHeight } = this.video;
    if (!videoWidth) return null;
    const scale = Math.min(1, most / videoWidth);
    const [width, height] = [Math.round(videoWidth * scale), Math.round(videoHeight * scale)];
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    this.context.drawImage(this.video, 0, 0, width, height);
    return this.context.getImageData(0, 0, width, height);
  }

  stop() {
    this.stopped = true;
    this.stream.getTracks().forEach((track) => track.stop());
    this.video.srcObject = null;
  }
}
