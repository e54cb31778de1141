// Renderer, camera, light and ground.
import {
  AxesHelper,
  Box3,
  BufferGeometry,
  Color,
  DirectionalLight,
  Float32BufferAttribute,
  Group,
  HemisphereLight,
  LineBasicMaterial,
  LineSegments,
  Object3D,
  PCFShadowMap,
  PerspectiveCamera,
  Scene,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Playback } from "../playback";
import type { Palette } from "../theme";

const FIELD_DEG = 38;
// Pictures narrower than this keep the width that they would have here, and show more above and below.
const NARROW = 1.35;
const MOST_PIXEL_RATIO = 2;
const GRID_CELLS = 24;
const ORBIT_STEP_RAD = Math.PI / 24;
const ZOOM_STEP = 1.15;

Object3D.DEFAULT_UP.set(0, 0, 1);

// Renderers that have no graphics card, by what they call themselves.
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

/** Makes a renderer, or returns null where the browser has no WebGL; shadows need a graphics card. */
export function makeRenderer(canvas: HTMLCanvasElement): WebGLRenderer | null {
  const attributes = { antialias: true, preserveDrawingBuffer: true, alpha: false };
  const context = canvas.getContext("webgl2", attributes) as WebGL2RenderingContext | null;
  if (!context) return null;
  const renderer = new WebGLRenderer({ canvas, context, ...attributes });
  // To read how each program was linked takes the time of linking it once more.
  renderer.debug.checkShaderErrors = false;
  renderer.shadowMap.enabled = !isSoftware(context);
  renderer.shadowMap.type = PCFShadowMap;
  return renderer;
}

function isSoftware(context: WebGL2RenderingContext): boolean {
  const names = context.getExtension("WEBGL_debug_renderer_info");
  return (
    names !== null && SOFTWARE.test(String(context.getParameter(names.UNMASKED_RENDERER_WEBGL)))
  );
}

export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(FIELD_DEG, 1, 0.01, 100);
  readonly controls: OrbitControls;
  /** The distance between lines of the ground, in m. */
  readonly grid_m: number;
  private readonly sky = new HemisphereLight(0xffffff, 0x888888, 1.7);
  private readonly sun = new DirectionalLight(0xffffff, 2.1);
  private readonly grid: LineSegments<BufferGeometry, LineBasicMaterial>[];

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly bounds: Box3,
    private readonly view: Playback["view"],
    changed: () => void,
  ) {
    const fill = new DirectionalLight(0xffffff, 0.55);
    fill.position.set(-1, -0.6, 0.4);
    this.scene.add(this.sky, this.sun, this.sun.target, fill);
    const span_m = Math.max(bounds.max.x - bounds.min.x, bounds.max.y - bounds.min.y);
    this.grid_m = span_m > 6 ? 1 : 0.1;
    this.grid = this.makeGround(span_m);
    this.controls = new OrbitControls(this.camera, renderer.domElement);
    this.controls.dampingFactor = 0.12;
    this.controls.enableDamping = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    // A page scrolls with the wheel; the picture zooms once somebody works with it.
    this.controls.enableZoom = false;
    this.controls.addEventListener("change", changed);
    this.placeSun();
    this.resetView();
  }

  recolour(palette: Palette): void {
    this.scene.background = new Color(palette.back);
    this.sky.color.set(palette.sky);
    this.sky.groundColor.set(palette.ground);
    this.grid[0]?.material.color.set(palette.grid);
    this.grid[1]?.material.color.set(palette["grid-metre"]);
  }

  /** Looks from where the document says, else from the front right, on everything. */
  resetView(): void {
    const centre = this.bounds.getCenter(new Vector3());
    const radius_m = this.bounds.getSize(new Vector3()).length() / 2 || 1;
    if (this.view) {
      this.controls.target.set(...this.view.target_m);
      this.camera.position.set(...this.view.eye_m);
    } else {
      const away_m = radius_m / Math.sin(((FIELD_DEG / 2) * Math.PI) / 180);
      this.controls.target.copy(centre);
      const direction = new Vector3(0.75, -1, 0.62).normalize();
      this.camera.position.copy(centre).addScaledVector(direction, away_m);
    }
    const away_m = this.camera.position.distanceTo(this.controls.target);
    this.controls.minDistance = radius_m / 50;
    this.controls.maxDistance = Math.max(away_m, radius_m) * 8;
    this.camera.near = radius_m / 200;
    this.camera.far = this.controls.maxDistance + radius_m * 20;
    this.camera.updateProjectionMatrix();
    this.controls.update();
  }

  resize(width: number, height: number): void {
    const aspect = width / Math.max(height, 1);
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, MOST_PIXEL_RATIO));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = aspect;
    const half = Math.tan(((FIELD_DEG / 2) * Math.PI) / 180);
    const taller = aspect < NARROW ? NARROW / aspect : 1;
    this.camera.fov = (Math.atan(half * taller) * 360) / Math.PI;
    this.camera.updateProjectionMatrix();
  }

  /** Turns the view round its target, in steps to the right and up. */
  orbit(right: number, up: number): void {
    this.controls.rotateLeft(right * ORBIT_STEP_RAD);
    this.controls.rotateUp(up * ORBIT_STEP_RAD);
    this.controls.update();
  }

  /** Moves the view by steps of a 20th of its distance. */
  pan(right: number, up: number): void {
    const step_m = this.camera.position.distanceTo(this.controls.target) / 20;
    const side = new Vector3().setFromMatrixColumn(this.camera.matrix, 0);
    const upwards = new Vector3().setFromMatrixColumn(this.camera.matrix, 1);
    this.shift(side.multiplyScalar(right * step_m).addScaledVector(upwards, up * step_m));
    this.controls.update();
  }

  zoom(steps: number): void {
    const arm = this.camera.position.clone().sub(this.controls.target);
    const wanted = arm.length() * ZOOM_STEP ** -steps;
    const { minDistance, maxDistance } = this.controls;
    arm.setLength(Math.min(Math.max(wanted, minDistance), maxDistance));
    this.camera.position.copy(this.controls.target).add(arm);
    this.controls.update();
  }

  /** Moves camera and target together. */
  shift(by: Vector3): void {
    this.camera.position.add(by);
    this.controls.target.add(by);
  }

  render(): void {
    this.renderer.render(this.scene, this.camera);
  }

  private placeSun(): void {
    const centre = this.bounds.getCenter(new Vector3());
    const radius_m = this.bounds.getSize(new Vector3()).length() / 2 || 1;
    this.sun.position.copy(centre).add(new Vector3(0.6, -0.7, 1.5).multiplyScalar(radius_m * 1.4));
    this.sun.target.position.copy(centre);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(1024, 1024);
    this.sun.shadow.radius = 3;
    this.sun.shadow.bias = -0.0004;
    this.sun.shadow.normalBias = radius_m * 0.004;
    this.sun.shadow.intensity = 0.55;
    const { camera } = this.sun.shadow;
    camera.left = camera.bottom = -radius_m;
    camera.right = camera.top = radius_m;
    camera.near = radius_m * 0.1;
    camera.far = radius_m * 5;
  }

  private makeGround(span_m: number): LineSegments<BufferGeometry, LineBasicMaterial>[] {
    const ground = new Group();
    const centre = this.bounds.getCenter(new Vector3());
    const step = this.grid_m;
    const cells = Math.max(GRID_CELLS, Math.ceil((span_m * 1.3) / step / 2) * 2);
    const middle = [Math.round(centre.x / step), Math.round(centre.y / step)] as const;
    const fine: number[] = [];
    const coarse: number[] = [];
    for (let line = -cells / 2; line <= cells / 2; line++) {
      const [x, y] = [(middle[0] + line) * step, (middle[1] + line) * step];
      const [x0, x1] = [(middle[0] - cells / 2) * step, (middle[0] + cells / 2) * step];
      const [y0, y1] = [(middle[1] - cells / 2) * step, (middle[1] + cells / 2) * step];
      ((middle[0] + line) % 10 === 0 ? coarse : fine).push(x, y0, 0, x, y1, 0);
      ((middle[1] + line) % 10 === 0 ? coarse : fine).push(x0, y, 0, x1, y, 0);
    }
    const lines = [fine, coarse].map((points) => {
      const geometry = new BufferGeometry();
      geometry.setAttribute("position", new Float32BufferAttribute(points, 3));
      return new LineSegments(geometry, new LineBasicMaterial());
    });
    const size_m = this.bounds.getSize(new Vector3()).length();
    ground.add(...lines);
    ground.position.z = this.bounds.min.z - size_m * 0.002;
    const axes = new AxesHelper(step);
    axes.position.z = size_m * 0.002;
    this.scene.add(ground, axes);
    return lines;
  }
}
