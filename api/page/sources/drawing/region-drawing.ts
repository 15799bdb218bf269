/** The region of interest while it is drawn: a mask of the camera's size, painted by polygons and a brush. */

export type Tool = "polygon" | "brush" | "eraser";
export type Point = readonly [number, number];

/** Side of the brush as a share of the image's width. */
const BRUSH_SHARE = 0.03;

export class RegionDrawing {
  private readonly mask: OffscreenCanvas;
  private readonly ink: OffscreenCanvasRenderingContext2D;
  /** Corners of the open polygon, px of the camera. */
  corners: Point[] = [];

  constructor(
    readonly width: number,
    readonly height: number,
  ) {
    this.mask = new OffscreenCanvas(width, height);
    this.ink = this.mask.getContext("2d", { willReadFrequently: true })!;
    this.ink.fillStyle = this.ink.strokeStyle = "#fff";
    this.ink.lineCap = this.ink.lineJoin = "round";
    this.ink.lineWidth = width * BRUSH_SHARE;
  }

  clear(): void {
    this.corners = [];
    this.ink.clearRect(0, 0, this.width, this.height);
  }

  /** Loads an existing mask, of which the white pixels count. */
  load(picture: ImageBitmap): void {
    this.clear();
    this.ink.drawImage(picture, 0, 0, this.width, this.height);
    const pixels = this.ink.getImageData(0, 0, this.width, this.height);
    for (let index = 0; index < pixels.data.length; index += 4) {
      pixels.data[index + 3] = pixels.data[index]! > 127 ? 255 : 0;
    }
    this.ink.putImageData(pixels, 0, 0);
  }

  stroke(from: Point, to: Point, tool: Tool): void {
    this.ink.globalCompositeOperation = tool === "eraser" ? "destination-out" : "source-over";
    this.ink.beginPath();
    this.ink.moveTo(...from);
    this.ink.lineTo(...to);
    this.ink.stroke();
    this.ink.globalCompositeOperation = "source-over";
  }

  closePolygon(): void {
    if (this.corners.length > 2) {
      this.ink.beginPath();
      this.corners.forEach((corner, index) => (index ? this.ink.lineTo(...corner) : this.ink.moveTo(...corner)));
      this.ink.closePath();
      this.ink.fill();
    }
    this.corners = [];
  }

  /** Number of pixels in the region. */
  get pixels(): number {
    const { data } = this.ink.getImageData(0, 0, this.width, this.height);
    let count = 0;
    for (let index = 3; index < data.length; index += 4) if (data[index]! > 127) count += 1;
    return count;
  }

  /** Draws the region over a picture with `scale` screen pixels per camera pixel. */
  show(over: CanvasRenderingContext2D, scale: number, colour: string, cursor: Point | null): void {
    const tint = new OffscreenCanvas(this.width, this.height);
    const tinted = tint.getContext("2d")!;
    tinted.drawImage(this.mask, 0, 0);
    tinted.globalCompositeOperation = "source-in";
    tinted.fillStyle = colour;
    tinted.fillRect(0, 0, this.width, this.height);
    over.globalAlpha = 0.35;
    over.drawImage(tint, 0, 0, this.width * scale, this.height * scale);
    over.globalAlpha = 1;
    over.strokeStyle = colour;
    over.lineWidth = 2;
    over.beginPath();
    this.corners.forEach(([x, y], index) =>
      index ? over.lineTo(x * scale, y * scale) : over.moveTo(x * scale, y * scale),
    );
    if (cursor && this.corners.length) over.lineTo(cursor[0] * scale, cursor[1] * scale);
    over.stroke();
    for (const [x, y] of cursor ? [...this.corners, cursor] : this.corners)
      over.strokeRect(x * scale - 3, y * scale - 3, 6, 6);
  }

  /** Returns the mask in the API's form: a PNG, white where wanted, black elsewhere. */
  async png(): Promise<Blob> {
    const sheet = new OffscreenCanvas(this.width, this.height);
    const ink = sheet.getContext("2d")!;
    ink.fillStyle = "#000";
    ink.fillRect(0, 0, this.width, this.height);
    ink.drawImage(this.mask, 0, 0);
    return sheet.convertToBlob({ type: "image/png" });
  }
}
