import { defineConfig } from "vite";

const SERVER = "http://127.0.0.1:8000";
const SERVER_PATHS = ["/v1", "/whep", "/healthz", "/readyz", "/docs", "/openapi.json"];

export default defineConfig({
  build: { target: "es2022", sourcemap: false },
  worker: { format: "es" },
  server: {
    // `npm run dev` beside `metanerf demo --no-browser`: the page reloads itself while one works
    proxy: Object.fromEntries(SERVER_PATHS.map((path) => [path, { target: SERVER, ws: true }])),
  },
});
