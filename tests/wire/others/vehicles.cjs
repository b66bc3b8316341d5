/* node vehicles.cjs PORT: two virtual vehicles of vda-5050-lib, robot_0 at a and robot_1 at e. */
const { AgvController, VirtualAgvAdapter } = require("vda-5050-lib");
const port = process.argv[2];
const at = { robot_0: [0, 0, "a"], robot_1: [8, 4, "e"] };
(async () => {
  for (const serial of Object.keys(at)) {
    const [x, y, node] = at[serial];
    const c = new AgvController({ manufacturer: "mrp_sumo", serialNumber: serial },
      { interfaceName: "uagv", transport: { brokerUrl: `mqtt://127.0.0.1:${port}` }, vdaVersion: "2.0.0" },
      { agvAdapterType: VirtualAgvAdapter, publishStateInterval: 1000, publishVisualizationInterval: 1000 },
      { initialPosition: { mapId: "L1", x, y, theta: 0, lastNodeId: node }, vehicleSpeed: 1, tickRate: 10 });
    await c.start();
  }
  console.log("ready");
})();
