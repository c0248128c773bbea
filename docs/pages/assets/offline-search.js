// Browsers start no workers from files. Search is then run in a hidden frame, which shares this
// page's origin and answers by messages as a worker does.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      this.onmessage = this.onerror = this.onmessageerror = null
      this.frame = document.createElement("iframe")
      this.frame.hidden = true
      document.documentElement.append(this.frame)
      const inside = this.frame.contentWindow
      inside.postMessage = (data) => this.answer(data)
      this.ready = new Promise((resolve) => {
        const script = inside.document.createElement("script")
        script.src = url
        script.onload = resolve
        script.onerror = (event) => this.onerror && this.onerror(event)
        inside.document.body.append(script)
      })
    }

    answer(data) {
      const event = new MessageEvent("message", { data })
      if (this.onmessage) this.onmessage(event)
      this.dispatchEvent(event)
    }

    postMessage(data) {
      this.ready.then(() => {
        const event = new MessageEvent("message", { data })
        const inside = this.frame.contentWindow
        if (inside && inside.onmessage) inside.onmessage(event)
      })
    }

    terminate() {
      this.frame.remove()
    }
  }
}
