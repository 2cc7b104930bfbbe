// The plan of the storey: who is where, and a click walks there.

/** How long is worked on a plan at a time, in milliseconds: while one moves, and while one stands. */
const WORK_MS = [8, 50];

/** The plan on a canvas. */
export class Plan {
  constructor(canvas, goTo) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.goTo = goTo;
    this.place = null;
    this.picture = null;
    canvas.addEventListener("click", (event) => this.click(event));
  }

  /** Goes on making the plan, and shows it as `state` has it. */
  show(client, state, isWanted) {
    if (isWanted && state.pose) this.make(client, state.pose);
    this.canvas.hidden = !isWanted || !this.picture;
    if (this.canvas.hidden) return;
    const { context, canvas, place } = this;
    this.soles = state.soles;
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.drawImage(this.picture, 0, 0);
    const at = ([x, , z]) => [(x - place.x) / place.metres, (z - place.z) / place.metres];
    const radius = Math.max(place.columns, place.rows) / 45;
    for (const person of state.people) {
      if (Math.abs(person.at[1] - state.pose[1]) < 2.4) this.disc(at(person.at), radius, person.colour);
    }
    const [x, y] = at(state.pose);
    const yaw = state.pose[3];
    context.strokeStyle = "#ff3030";
    context.lineWidth = radius * 0.9;
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x - Math.sin(yaw) * radius * 3.4, y - Math.cos(yaw) * radius * 3.4);
    context.stroke();
    this.disc([x, y], radius * 1.15, "#ff3030");
  }

  make(client, pose) {
    const stands = String(pose) === this.stood;
    this.stood = String(pose);
    const end = performance.now() + WORK_MS[Number(stands)];
    do {
      if (client.make_plan(1)) {
        this.take(client);
        return;
      }
    } while (client.makes_plan() && performance.now() < end);
  }

  disc([x, y], radius, colour) {
    const { context } = this;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fillStyle = colour;
    context.fill();
    context.strokeStyle = "#12161a";
    context.lineWidth = radius * 0.35;
    context.stroke();
  }

  take(client) {
    this.place = JSON.parse(client.plan());
    const { columns, rows } = this.place;
    const image = new ImageData(new Uint8ClampedArray(client.plan_pixels()), columns, rows);
    this.picture = document.createElement("canvas");
    Object.assign(this.picture, { width: columns, height: rows });
    this.picture.getContext("2d").putImageData(image, 0, 0);
    Object.assign(this.canvas, { width: columns, height: rows });
  }

  click(event) {
    const { canvas, place } = this;
    const style = getComputedStyle(canvas);
    const [padX, padY] = [style.paddingLeft, style.paddingTop].map(Number.parseFloat);
    const column = ((event.offsetX - padX) / (canvas.clientWidth - 2 * padX)) * place.columns;
    const row = ((event.offsetY - padY) / (canvas.clientHeight - 2 * padY)) * place.rows;
    this.goTo(place.x + column * place.metres, this.soles, place.z + row * place.metres);
  }
}
