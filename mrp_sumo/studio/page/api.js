/* What the page asks of its server; addresses are relative, so that the token in the page's own goes along. */

async function said(response) {
  const body = await response.json().catch(() => ({ error: response.statusText }));
  if (!response.ok) throw Object.assign(new Error(body.error || response.statusText), { status: response.status });
  return body;
}

async function asked(address, options) {
  let response;
  try {
    response = await fetch(address, options);
  } catch {
    throw Object.assign(new Error("the server has ended: start `mrp-sumo studio` again; what is drawn here is not lost as long as this page is open"), { status: 0 });
  }
  return said(response);
}

export const get = (name, values = {}) => asked(`api/${name}?${new URLSearchParams(values)}`);
export const post = (name, values) => asked(`api/${name}`, { method: "POST", body: JSON.stringify(values) });
