import { defineConfig } from "vitest/config";

const SERVER = "http://127.0.0.1:8000";
const SERVER_PATHS = ["/v1", "/whep", "/healthz", "/readyz", "/docs", "/openapi.json"];

export default defineConfig({
  build: { target: "es2022", sourcemap: false },
  worker: { format: "es" },
  // no test is of speed: on a busy machine the first one of a file waits for all that it imports
  test: { testTimeout: 60_000, hookTimeout: 60_000 },
  server: {
    // `npm run dev` beside `metanerf demo --no-browser`: the page reloads itself while one works
    proxy: Object.fromEntries(SERVER_PATHS.map((path) => [path, { target: SERVER, ws: true }])),
  },
});
