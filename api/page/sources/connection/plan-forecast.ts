/**
 * Forecasts for lights that are being dragged. One request is sent at a time, and the next one takes the lights'
 * positions at that time, so that the forecast neither lags behind the pointer nor queues up in the service.
 */
import type { components } from "./api-types";
import { post, send, UNLIMITED } from "./requests";
import type { Vector3 } from "./schemas";

export type LightForecast = components["schemas"]["LightForecast"];

export class PlanForecasting {
  private wanted: readonly Vector3[] | null = null;
  private running = false;

  /** `tell` is called with each forecast, `fail` with each error. */
  constructor(
    private readonly address: string,
    private readonly tell: (forecast: LightForecast) => void,
    private readonly fail: (error: unknown) => void,
  ) {}

  /** Requests the forecast of these lights once the present request is answered. */
  ask(lights: readonly Vector3[]): void {
    this.wanted = lights;
    if (!this.running) void this.run();
  }

  /** Returns σ over the object for these lights as a picture, dark where it is small. */
  async picture(lights: readonly Vector3[]): Promise<Blob> {
    const options = { body: { lights }, headers: { Accept: "image/png" }, timeoutMs: UNLIMITED };
    return (await send("POST", this.address, options)).blob();
  }

  private async run(): Promise<void> {
    this.running = true;
    while (this.wanted) {
      const lights = this.wanted;
      this.wanted = null;
      try {
        this.tell(await post<LightForecast>(this.address, { lights }, { timeoutMs: UNLIMITED }));
      } catch (error) {
        this.fail(error);
      }
    }
    this.running = false;
  }
}
