# A plain installation that runs as a user: docker build -t mrp-sumo . && docker run --rm -v "$PWD:/work" mrp-sumo run office_9
FROM python:3.11-slim
RUN apt-get update && apt-get install -y --no-install-recommends libgl1 libglu1-mesa libxcursor1 libxft2 libxi6 libxinerama1 libxrandr2 && rm -rf /var/lib/apt/lists/*
WORKDIR /source
COPY requirements/ requirements/
RUN pip install --no-cache-dir --require-hashes --requirement requirements/build.txt --requirement requirements/run.txt
COPY . .
RUN pip install --no-cache-dir --no-deps --no-build-isolation . && useradd --create-home user
USER user
# compiled once, for every container
RUN mrp-sumo warmup --quiet
WORKDIR /work
ENTRYPOINT ["mrp-sumo"]
