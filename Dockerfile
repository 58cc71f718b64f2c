# One image for every process: gateway, capture worker, training worker (metanerf); the same for a
# machine with a CUDA device (gpu), and with Ray for the nodes of a cluster (cluster); and the proxy in front.
FROM caddy:2.10.0 AS proxy
# its volumes are root's unless the image says otherwise
RUN adduser -D -H -u 10002 proxy && chown proxy /data /config
USER proxy

FROM node:20.19.2-slim AS page
WORKDIR /client
COPY client/package.json client/package-lock.json ./
RUN npm ci --no-audit --no-fund
COPY client ./
RUN npm run build

FROM python:3.11.13-slim AS metanerf
# libgl1 and libegl1: MediaPipe loads them; curl: the health check
RUN apt-get update && apt-get install -y --no-install-recommends libgl1 libegl1 libglib2.0-0 libgomp1 curl \
    && rm -rf /var/lib/apt/lists/* && useradd --no-create-home --home-dir /data --uid 10001 metanerf
WORKDIR /app
# what services.setting_groups would have fetched, by the hashes that capture/detection/network_files.py knows
ADD --chmod=644 --checksum=sha256:5134a3aad27a58b93da0088d431f366da362b44e3ccfbe3462b3827a839011b1 \
    https://storage.googleapis.com/mediapipe-models/pose_landmarker/pose_landmarker_full/float16/1/pose_landmarker_full.task models/
ADD --chmod=644 --checksum=sha256:64184e229b263107bc2b804c6625db1341ff2bb731874b0bcc2fe6544e0bc9ff \
    https://storage.googleapis.com/mediapipe-models/face_landmarker/face_landmarker/float16/1/face_landmarker.task models/
ADD --chmod=644 --checksum=sha256:fbc2a30080c3c557093b5ddfc334698132eb341044ccee322ccf8bcf3607cde1 \
    https://storage.googleapis.com/mediapipe-models/hand_landmarker/hand_landmarker/float16/1/hand_landmarker.task models/
ENV METANERF_POSE_MODEL=/app/models/pose_landmarker_full.task \
    METANERF_FACE_MODEL=/app/models/face_landmarker.task METANERF_HAND_MODEL=/app/models/hand_landmarker.task
COPY requirements.lock pyproject.toml README.md LICENSE NOTICE ./
# torch by version alone: its builds differ from machine to machine
RUN pip install --no-cache-dir torch==2.13.0 --index-url https://download.pytorch.org/whl/cpu \
    && pip install --no-cache-dir --no-deps --require-hashes -r requirements.lock
COPY scene scene
COPY db db
COPY capture capture
COPY renderer renderer
COPY services services
COPY benchmarks benchmarks
RUN pip install --no-cache-dir --no-deps --no-build-isolation -e .
# kernels for x86 of the last ten years; elsewhere numba takes it for `generic`, which draws half as fast and
# is what an older x86 needs. The features are the name's, not those of the machine that builds.
ARG CPU=x86-64-v3
ENV NUMBA_CPU_NAME=$CPU NUMBA_CPU_FEATURES= NUMBA_CACHE_DIR=/tmp/kernels
# on a read-only root nothing could be compiled and kept later; the base image lacks the library's bytecode
RUN python -m compileall -q -x '/(site-packages|tests?)/' /usr/local/lib/python3.11 \
    && python -m compileall -q scene db capture renderer services benchmarks
RUN export NUMBA_CACHE_DIR=/app/kernels \
    && python -c "from renderer.scene_renderer import warm_up; warm_up()" \
    && python -c "from capture.fitting.warm_up import warm_up; warm_up()" \
    && python -c "from services.live.motion.live_motion import warm_up; warm_up()" \
    && metanerf studio --out /tmp/made/clip --frames 8 --size 64 --test-cameras 1 --look plain \
    && metanerf train /tmp/made/clip --out /tmp/made/model.safetensors --preset splats --budget 1s && rm -r /tmp/made
COPY --from=page /client/dist client/dist
RUN mkdir /data && chown metanerf /data
USER metanerf
ENV METANERF_DATA_DIR=/data METANERF_CLIENT_DIR=/app/client/dist METANERF_HOST=0.0.0.0
EXPOSE 8000
# numba takes no cache that it cannot write to
ENTRYPOINT ["/bin/sh", "-c", "cp -r /app/kernels /tmp/; exec \"$0\" \"$@\""]
CMD ["metanerf", "serve"]

FROM metanerf AS gpu
USER root
# gcc: Triton compiles its launchers with it
RUN apt-get update && apt-get install -y --no-install-recommends gcc libc6-dev && rm -rf /var/lib/apt/lists/* \
    && pip install --no-cache-dir --force-reinstall torch==2.13.0
USER metanerf

FROM metanerf AS cluster
USER root
COPY requirements-cluster.lock ./
RUN pip install --no-cache-dir --no-deps --require-hashes -r requirements-cluster.lock
USER metanerf

# what is built where nobody names a stage
FROM metanerf
